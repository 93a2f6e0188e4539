//! The shaders as text, no device needed: every one composes and is valid, and its structs lie as
//! those of Rust.

use std::mem::{offset_of, size_of};

use super::cull::CullGroup;
use super::radix::{RadixPlan, RadixState};
use super::resolve::Background;
use super::shaders::Shader;
use super::tile::TileProgress;
use crate::blocks::MergeBounds;
use crate::layout::{
    BlockView, BrickUniform, CameraUniform, ChoiceUniform, ChunkState, ChunkUniform,
    ClassifiedParticle, DeviceBlock, ExactTerms, Footprint, FrameState, LatticeUniform,
    LightUniform, LightingUniform, MergedBlock, NearTerms, PartIndex, PartRange, PartState,
    SortState, SurfelTerms, ViewUniform,
};
use naga::TypeInner;
use naga::valid::{Capabilities, ValidationFlags, Validator};

#[test]
fn every_shader_is_valid() {
    for shader in Shader::ALL {
        let source = shader.source();
        let module = naga::front::wgsl::parse_str(&source)
            .unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(&source, shader.name)));
        Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(&module)
            .unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(&source, shader.name)));
    }
}

/// Name, offset and size of a struct's members as WGSL lays them out, and the distance of two in
/// an array.
fn reflected(name: &str) -> (Vec<(String, usize, usize)>, usize) {
    let find = |shader: &Shader| {
        let module = naga::front::wgsl::parse_str(&shader.source()).unwrap();
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        let is_named = |ty: &naga::Type| ty.name.as_deref() == Some(name);
        let (handle, ty) = module.types.iter().find(|(_, ty)| is_named(ty))?;
        let TypeInner::Struct { members, .. } = &ty.inner else {
            panic!("{name} is no struct");
        };
        let member = |m: &naga::StructMember| {
            let size = layouter[m.ty].size;
            (m.name.clone().unwrap(), m.offset as usize, size as usize)
        };
        let members = members.iter().map(member).collect();
        Some((members, layouter[handle].to_stride() as usize))
    };
    let found = Shader::ALL.iter().find_map(find);
    found.unwrap_or_else(|| panic!("no struct {name}"))
}

macro_rules! check_layout {
    ($type:ident { $($member:ident),* $(,)? }) => {{
        // A member that is missing here does not compile.
        let zero: $type = bytemuck::Zeroable::zeroed();
        let $type { $($member),* } = zero;
        let expected = vec![
            $((stringify!($member).to_string(), offset_of!($type, $member), size_of_val(&$member))),*
        ];
        assert_eq!(
            reflected(stringify!($type)),
            (expected, size_of::<$type>()),
            stringify!($type)
        );
    }};
}

#[test]
fn structs_are_laid_out_alike() {
    check_layout!(ViewUniform {
        focal_px,
        centre_px,
        size,
        orthographic,
        filter_kind,
        low_pass_variance_px2,
        tolerance,
        cutoff,
        key_scale,
        show_choice,
        directional_keys,
        layer_near,
        layer_thickness,
        key_axis,
        layer_shift,
        composite,
        clip_count,
        sub_pixel_opacity,
        unused,
        clip_planes,
    });
    check_layout!(CameraUniform {
        eye,
        camera_from_world,
        plane_normals,
        plane_distances,
        plane_spreads,
        key_axis,
        key_near,
        keys_per_unit,
        rotation,
        has_frustum,
        orthographic,
        directional_keys,
        plane_count,
        unused,
        choice,
    });
    check_layout!(ChoiceUniform {
        focal_px,
        thresholds,
        by_hand,
        orthographic,
        filter_kind,
        low_pass_variance_px2,
        tolerance,
        level_of_detail,
    });
    check_layout!(LightUniform { direction, colour });
    check_layout!(LightingUniform {
        lights,
        count,
        orthographic,
        ambient,
        diffuse,
        specular,
        shininess,
        unused,
    });
    check_layout!(BrickUniform { dims, first });
    check_layout!(FrameState {
        nearest,
        farthest,
        near,
        keys_per_unit,
        classified_count,
        filters,
    });
    check_layout!(PartState {
        capacity,
        view_count,
        count_length,
        needed,
        classified_count,
        first,
    });
    check_layout!(DeviceBlock {
        origin,
        half_extent,
        max_sigma,
        min_sigma,
        max_strength,
        value_range,
        first,
        count,
        parent,
        level,
    });
    check_layout!(MergeBounds {
        third_mean,
        third,
        fourth,
        second,
        spread,
        colour,
    });
    check_layout!(MergedBlock { parent, state });
    check_layout!(LatticeUniform {
        dims,
        bricks,
        first_brick,
        has_axes,
        basis,
        factor,
    });
    check_layout!(BlockView {
        origin_camera,
        block,
        first,
        count,
        key,
        filter_kind,
        level,
    });
    check_layout!(ClassifiedParticle {
        view,
        local,
        mass,
        colour,
    });
    check_layout!(Footprint {
        centre_px,
        form_p,
        form_r,
        tau,
        cutoff_squared,
        colour,
        depth,
        path,
        columns,
        rows,
        key,
    });
    check_layout!(ExactTerms {
        gradient,
        hessian,
        depth_sigma
    });
    check_layout!(SurfelTerms {
        gradient,
        nearness,
        slack,
        homography,
        normal,
    });
    check_layout!(NearTerms {
        misses,
        minors,
        minor_depths,
        sigma,
        half_line,
    });
    check_layout!(PartIndex { index });
    check_layout!(PartRange { first, count });
    check_layout!(SortState {
        count,
        visible,
        exact
    });
    check_layout!(ChunkUniform {
        start,
        capacity,
        band_first,
        band_size,
        is_last,
        unused,
    });
    check_layout!(ChunkState {
        length,
        offset_count,
        entries,
        needed,
    });
    // Of single stages.
    check_layout!(CullGroup {
        count,
        unused,
        nearest,
        farthest,
    });
    check_layout!(RadixPlan {
        count_index,
        capacity,
    });
    check_layout!(RadixState {
        count,
        groups,
        table_length,
    });
    check_layout!(TileProgress {
        drawn,
        hidden,
        splat_pixels,
        first_layer,
        layers_needed,
    });
    check_layout!(Background { colour, pixels });
}
