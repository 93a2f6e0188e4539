! Draws a regular grid from Fortran: grid FILE
! The file receives the pixels, 4 floats each, rows from the top. Arrays need no copies: x is the fastest index here, too.
program grid
  use, intrinsic :: iso_c_binding
  implicit none

  integer(c_int32_t), parameter :: ewa_f32 = 1, ewa_nodes = 0
  integer, parameter :: width = 64, height = 48

  type, bind(c) :: ewa_array
    type(c_ptr) :: name = c_null_ptr, data = c_null_ptr
    integer(c_size_t) :: count = 0, stride = 0
    integer(c_int32_t) :: kind = 0
  end type

  type, bind(c) :: ewa_buffers
    type(c_ptr) :: rgba = c_null_ptr
    integer(c_size_t) :: rgba_count = 0
    type(c_ptr) :: rgba8 = c_null_ptr
    integer(c_size_t) :: rgba8_count = 0
    type(c_ptr) :: depth = c_null_ptr
    integer(c_size_t) :: depth_count = 0
    type(c_ptr) :: normals = c_null_ptr
    integer(c_size_t) :: normals_count = 0
  end type

  interface
    integer(c_int32_t) function ewa_scene_grid(dims, origin, spacing, direction, values, of, options, scene) bind(c)
      import
      integer(c_size_t), intent(in) :: dims(3)
      real(c_double), intent(in) :: origin(3), spacing(3)
      type(c_ptr), value :: direction
      type(ewa_array), intent(in) :: values
      integer(c_int32_t), value :: of
      character(kind=c_char), intent(in) :: options(*)
      type(c_ptr), intent(out) :: scene
    end function
    integer(c_int32_t) function ewa_renderer_new(scenes, scene_count, options, renderer) bind(c)
      import
      type(c_ptr), intent(in) :: scenes(*)
      integer(c_size_t), value :: scene_count
      character(kind=c_char), intent(in) :: options(*)
      type(c_ptr), intent(out) :: renderer
    end function
    integer(c_int32_t) function ewa_render(renderer, camera, settings, width, height, task, buffers) bind(c)
      import
      type(c_ptr), value :: renderer, camera, task
      character(kind=c_char), intent(in) :: settings(*)
      integer(c_size_t), value :: width, height
      type(ewa_buffers), intent(in) :: buffers
    end function
    subroutine ewa_scene_free(scene) bind(c)
      import
      type(c_ptr), value :: scene
    end subroutine
    subroutine ewa_renderer_free(renderer) bind(c)
      import
      type(c_ptr), value :: renderer
    end subroutine
    type(c_ptr) function ewa_last_error() bind(c)
      import
    end function
    integer(c_size_t) function strlen(text) bind(c)
      import
      type(c_ptr), value :: text
    end function
  end interface

  real(c_float), target :: values(12, 10, 8)
  real(c_float), target :: pixels(4, width, height)
  character(kind=c_char), target :: name(5) = ['h', 'e', 'a', 't', c_null_char]
  character(len=1000) :: path
  type(ewa_array) :: field
  type(ewa_buffers) :: buffers
  type(c_ptr) :: scene, renderer
  integer :: i, j, k, unit

  do k = 1, 8
    do j = 1, 10
      do i = 1, 12
        values(i, j, k) = real((i - 1) * (j - 1) + 4 * (k - 1), c_float)
      end do
    end do
  end do
  field = ewa_array(c_loc(name), c_loc(values), size(values, kind=c_size_t), 0_c_size_t, ewa_f32)
  call check(ewa_scene_grid([12_c_size_t, 10_c_size_t, 8_c_size_t], [0d0, 0d0, 0d0], [1d0, 1d0, 1d0], c_null_ptr, field, &
    ewa_nodes, '{"transfer_function": "plasma"}' // c_null_char, scene))
  call check(ewa_renderer_new([scene], 1_c_size_t, '{"backend": "cpu"}' // c_null_char, renderer))
  buffers%rgba = c_loc(pixels)
  buffers%rgba_count = size(pixels, kind=c_size_t)
  call check(ewa_render(renderer, c_null_ptr, '{"background": [0, 0, 0]}' // c_null_char, int(width, c_size_t), &
    int(height, c_size_t), c_null_ptr, buffers))
  call ewa_renderer_free(renderer)
  call ewa_scene_free(scene)
  call get_command_argument(1, path)
  open(newunit=unit, file=trim(path), access='stream', form='unformatted', status='replace')
  write(unit) pixels
  close(unit)

contains

  subroutine check(status)
    integer(c_int32_t), intent(in) :: status
    character(kind=c_char), pointer :: text(:)
    type(c_ptr) :: last
    if (status == 0) return
    last = ewa_last_error()
    call c_f_pointer(last, text, [strlen(last)])
    print '(1000a)', text
    stop 1
  end subroutine

end program
