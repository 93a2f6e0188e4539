//! Tests the shaders as text, without a device: each one composes and is valid, and its structs have the
//! layout of the Rust structs.

use std::mem::{offset_of, size_of};

use super::classify::AmplitudeUniform;
use super::cull::CullGroup;
use super::radix::RadixPass;
use super::resolve::Background;
use super::shader::Shader;
use super::tile::TileProgress;
use crate::blocks::MergeBounds;
use crate::record::{
    BlockView, BrickUniform, CameraUniform, ChoiceUniform, ChunkState, ChunkUniform,
    ClassifiedParticle, DeviceBlock, ExactTerms, Footprint, FrameState, LatticeUniform,
    LightShadow, LightUniform, LightingUniform, MergedBlock, NearTerms, PartIndex, PartRange,
    PartState, PieceTerms, ShadowUniform, SortState, SurfelTerms, ViewUniform,
};
use crate::splat::Profiles;
use naga::back::pipeline_constants::process_overrides;
use naga::back::{PipelineConstants, hlsl, msl, spv};
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{Expression, Statement, TypeInner};
use rayon::prelude::*;

#[test]
fn every_shader_is_valid() {
    for shader in Shader::all() {
        let source = shader.source();
        let module = naga::front::wgsl::parse_str(&source)
            .unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(&source, &shader.name)));
        Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(&module)
            .unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(&source, &shader.name)));
    }
}

/// WGSL guarantees this much memory of its own to a thread, bytes.
const PRIVATE_BYTES: u32 = 8192;

#[test]
fn threads_take_no_more_memory_than_every_browser_has() {
    for shader in Shader::all() {
        let module = naga::front::wgsl::parse_str(&shader.source()).unwrap();
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        let private = module
            .global_variables
            .iter()
            .filter(|(_, variable)| variable.space == naga::AddressSpace::Private);
        let bytes: u32 = private
            .map(|(_, variable)| layouter[variable.ty].size)
            .sum();
        // Other devices have a variant with fewer layers: `layer_slots`.
        let is_other = shader.name.contains("256 layers, classified, lit");
        assert!(
            is_other || bytes <= PRIVATE_BYTES,
            "{}: {bytes} bytes",
            shader.name
        );
    }
}

/// Returns the type that a pointer into a local variable points to, and whether an index on the way is
/// computed.
fn local_pointee(
    module: &naga::Module,
    function: &naga::Function,
    pointer: naga::Handle<Expression>,
) -> Option<(naga::Handle<naga::Type>, bool)> {
    let member = |of: naga::Handle<naga::Type>, i: usize| match &module.types[of].inner {
        TypeInner::Struct { members, .. } => Some(members[i].ty),
        TypeInner::Array { base, .. } => Some(*base),
        _ => None,
    };
    match function.expressions[pointer] {
        Expression::LocalVariable(variable) => Some((function.local_variables[variable].ty, false)),
        Expression::AccessIndex { base, index } => {
            let (of, is_computed) = local_pointee(module, function, base)?;
            Some((member(of, index as usize)?, is_computed))
        }
        Expression::Access { base, .. } => {
            let (of, _) = local_pointee(module, function, base)?;
            Some((member(of, 0)?, true))
        }
        _ => None,
    }
}

/// Counts the stores of three numbers at a computed index of a local variable.
fn computed_triples(
    module: &naga::Module,
    function: &naga::Function,
    block: &naga::Block,
) -> usize {
    let within = |block: &naga::Block| computed_triples(module, function, block);
    let of_statement = |statement: &Statement| match statement {
        Statement::Block(block) => within(block),
        Statement::If { accept, reject, .. } => within(accept) + within(reject),
        Statement::Switch { cases, .. } => cases.iter().map(|case| within(&case.body)).sum(),
        Statement::Loop {
            body, continuing, ..
        } => within(body) + within(continuing),
        Statement::Store { pointer, .. } => {
            let stored = local_pointee(module, function, *pointer);
            let is_triple = stored.is_some_and(|(of, is_computed)| {
                let three = std::num::NonZero::new(3).unwrap();
                let of_three = naga::ArraySize::Constant(three);
                is_computed
                    && matches!(module.types[of].inner, TypeInner::Array { size, .. } if size == of_three)
            });
            usize::from(is_triple)
        }
        _ => 0,
    };
    block.iter().map(of_statement).sum()
}

/// NVIDIA's driver (580.159.04, on an H200) loses components of `array<f32, 3>` that are stored at a computed
/// index of a local variable.
#[test]
fn no_triple_is_stored_at_a_computed_index() {
    let count = |source: &str| -> usize {
        let module = naga::front::wgsl::parse_str(source).unwrap();
        let functions = module.functions.iter().map(|(_, function)| function);
        let entries = module.entry_points.iter().map(|entry| &entry.function);
        let in_function = |f: &naga::Function| computed_triples(&module, f, &f.body);
        functions.chain(entries).map(in_function).sum()
    };
    for shader in Shader::all() {
        assert_eq!(count(&shader.source()), 0, "{}", shader.name);
    }
    let lost = "fn f() { var a: array<array<f32, 3>, 5>; for (var i = 0; i < 5; i++) \
                { a[i] = array<f32, 3>(1.0, 2.0, 3.0); } }";
    assert_eq!(count(lost), 1);
}

/// Returns the values with which a shader's constants are tested: as declared, each other value alone,
/// and the last value of all of them.
fn specialisations(module: &naga::Module) -> Vec<PipelineConstants> {
    // Numbers select kinds and kernels, or are indices: four values reach every kind.
    let values = |constant: &naga::Override| match module.types[constant.ty].inner {
        TypeInner::Scalar(naga::Scalar::BOOL) => vec![0.0, 1.0],
        _ => vec![0.0, 1.0, 2.0, 3.0],
    };
    let all: Vec<(String, Vec<f64>)> = module
        .overrides
        .iter()
        .map(|(_, constant)| (constant.name.clone().unwrap(), values(constant)))
        .collect();
    let mut sets = vec![PipelineConstants::default()];
    for (name, values) in &all {
        for value in values {
            sets.push([(name.clone(), *value)].into_iter().collect());
        }
    }
    let last = |(name, values): &(String, Vec<f64>)| (name.clone(), *values.last().unwrap());
    sets.push(all.iter().map(last).collect());
    sets
}

/// Translates one kernel to the languages of Vulkan, Metal and DirectX 12.
fn translate(module: &naga::Module, info: &ModuleInfo, entry: &naga::EntryPoint) {
    let checks = naga::proc::BoundsCheckPolicies {
        index: naga::proc::BoundsCheckPolicy::Restrict,
        buffer: naga::proc::BoundsCheckPolicy::Restrict,
        ..Default::default()
    };
    let named = Some((entry.stage, entry.name.clone()));

    let options = spv::Options {
        lang_version: (1, 3),
        bounds_check_policies: checks,
        ..Default::default()
    };
    let pipeline = spv::PipelineOptions {
        shader_stage: entry.stage,
        entry_point: entry.name.clone(),
    };
    let words = spv::write_vec(module, info, &options, Some(&pipeline)).unwrap();
    assert_eq!(words[0], 0x0723_0203, "no SPIR-V");

    let options = msl::Options {
        lang_version: (2, 0),
        bounds_check_policies: checks,
        ..Default::default()
    };
    let pipeline = msl::PipelineOptions {
        entry_point: named.clone(),
        ..Default::default()
    };
    let (text, names) = msl::write_string(module, info, &options, &pipeline).unwrap();
    let [Ok(name)] = names.entry_point_names.as_slice() else {
        panic!("{:?}", names.entry_point_names);
    };
    assert!(text.contains(&format!(" {name}(")), "{text}");

    let options = hlsl::Options::default();
    let pipeline = hlsl::PipelineOptions { entry_point: named };
    let mut text = String::new();
    let names = hlsl::Writer::new(&mut text, &options, &pipeline)
        .write(module, info, None)
        .unwrap();
    let [Ok(name)] = names.entry_point_names.as_slice() else {
        panic!("{:?}", names.entry_point_names);
    };
    assert!(text.contains(&format!(" {name}(")), "{text}");
}

/// Checks that every kernel, for every constant that specialises it, can be translated for Metal and
/// DirectX 12. No machine with these is needed.
#[test]
fn every_specialised_shader_is_translated() {
    let shaders = Shader::all();
    let kernels: usize = shaders
        .par_iter()
        .map(|shader| {
            let module = naga::front::wgsl::parse_str(&shader.source()).unwrap();
            let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
                .validate(&module)
                .unwrap();
            let sets = specialisations(&module);
            for constants in &sets {
                for entry in &module.entry_points {
                    let named = Some((entry.stage, entry.name.as_str()));
                    let (module, info) = process_overrides(&module, &info, named, constants)
                        .unwrap_or_else(|e| panic!("{}, {constants:?}: {e}", shader.name));
                    assert_eq!(module.entry_points.len(), 1);
                    translate(&module, &info, &module.entry_points[0]);
                }
            }
            sets.len() * module.entry_points.len()
        })
        .sum();
    println!("{kernels} kernels, three languages each");
    // Some shaders have several kernels, or specialisations.
    assert!(kernels > shaders.len());
}

/// Returns name, offset and size of a struct's members as WGSL lays them out, and the stride of an array
/// of the struct.
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
    let found = Shader::all().iter().find_map(find);
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
        key_kind,
        layer_first,
        layer_thickness,
        key_axis,
        layer_shift,
        keys_begin,
        clip_count,
        sub_pixel_opacity,
        least_length,
        aperture,
        per_focus,
        unused,
        smoothing,
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
        key_kind,
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
        merge_tolerance,
        classified_by,
        slab_thickness,
    });
    check_layout!(LightUniform { direction, colour });
    check_layout!(Profiles { knots, signs });
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
    check_layout!(LightShadow {
        to_cells,
        size,
        first,
        map_size,
        map_first,
        map_scale,
        map_corner,
        bias,
        softness,
    });
    check_layout!(ShadowUniform { lights });
    check_layout!(BrickUniform {
        dims,
        first,
        values_first,
        kernel_width,
        models_first,
        unused,
        model_scales,
        unused_end,
    });
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
        crowding,
        greatest_spread,
        values_around,
        edges,
        unused,
    });
    check_layout!(MergeBounds {
        third_mean,
        third,
        fourth,
        second,
        spread,
        colour,
        uneven,
    });
    check_layout!(MergedBlock { parent, state });
    check_layout!(LatticeUniform {
        dims,
        bricks,
        first_brick,
        has_axes,
        basis,
        factor,
        face_normals,
        first_face,
    });
    check_layout!(BlockView {
        origin_camera,
        block,
        first,
        count,
        key,
        filter_kind,
        level,
        classified_by,
    });
    check_layout!(ClassifiedParticle {
        view,
        local,
        mass,
        carried,
    });
    check_layout!(Footprint {
        centre_px,
        form_p,
        form_r,
        tau,
        cutoff_squared,
        carried,
        depth,
        path,
        columns,
        rows,
        key,
    });
    check_layout!(PieceTerms {
        axis,
        shift,
        width,
        unused,
    });
    check_layout!(ExactTerms {
        gradient,
        hessian,
        depth_sigma,
        edges,
    });
    check_layout!(SurfelTerms {
        gradient,
        inverse_depth,
        slack,
        homography,
        normal,
        unused,
    });
    check_layout!(NearTerms {
        misses,
        minors,
        minor_depths,
        sigma,
        unit,
        reach,
        half_line,
        edges,
        edge_count,
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
    // Structs of single stages.
    check_layout!(CullGroup {
        count,
        unused,
        nearest,
        farthest,
    });
    check_layout!(AmplitudeUniform { scale, cell_volume });
    check_layout!(RadixPass {
        shift,
        digits,
        count_index,
        capacity,
    });
    check_layout!(TileProgress {
        drawn,
        hidden,
        splat_pixels,
        first_layer,
        layers_needed,
    });
    check_layout!(Background {
        colour,
        pixels,
        is_shown,
        is_encoded,
        unused,
    });
}
