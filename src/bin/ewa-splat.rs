//! Runs the command line: see `ewa_splat::command`.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;
use std::process::ExitCode;

/// The system's allocator. If an allocation fails, it prints an error and ends the program instead
/// of aborting. Within [`ewa_splat::memory::is_tried`], callers get the failure instead.
struct OrEnds;

#[allow(
    unsafe_code,
    reason = "what happens without memory can be said in no other place; every call is handed on as it came"
)]
// SAFETY: every request goes to the system's allocator unchanged, and its result is returned
// unchanged.
unsafe impl GlobalAlloc for OrEnds {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as the caller promises.
        or_end(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as the caller promises.
        or_end(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as the caller promises.
        or_end(unsafe { System.realloc(pointer, layout, size) }, size)
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: OrEnds = OrEnds;

fn or_end(pointer: *mut u8, size: usize) -> *mut u8 {
    if pointer.is_null() && !ewa_splat::memory::is_tried() {
        // This function allocates nothing.
        let mut out = std::io::stderr().lock();
        let _ = writeln!(
            out,
            "error: memory: expected {size} bytes more, found none left; take a part of the data (--crop), leave levels of \
             detail out (--level-of-detail off), or draw a prepared scene (convert --out FILE.arrow)"
        );
        std::process::exit(1);
    }
    pointer
}

fn main() -> ExitCode {
    ewa_splat::command::main()
}
