// Counts and emits particles that become at most one kernel. classify/alone.wgsl or
// classify/neighbours.wgsl has `prepare` and `visit_shown`, which counting and emitting share. Should a
// compiler round the two differently all the same, a view keeps to its range.

// Returns the number of kernels of a thread's particle.
fn kernel_count(view: BlockView, thread: u32) -> u32 {
    return u32(is_positive(visit_shown(view, thread).mass));
}

@compute @workgroup_size(THREADS)
fn classify_emit(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let v = group_index(group);
    // Emits nothing if the capacity is too small for all.
    let is_view = v < state.view_count && state.classified_count > 0u;
    var particle = Visit(0u, 0.0, vec4<f32>(0.0));
    if is_view {
        prepare(views[v], thread);
    }
    workgroupBarrier();
    if is_view {
        particle = visit_shown(views[v], thread);
    }
    let is_visible = is_positive(particle.mass);
    let place = scan_threads(thread, u32(is_visible));
    if !is_view {
        return;
    }
    let view = views[v];
    if is_visible && place < view.count {
        let carried = carried_by(particle);
        classified[view.first + place] = ClassifiedParticle(v, thread, particle.mass, carried);
    }
    if thread >= scan_total && thread < view.count {
        classified[view.first + thread] = ClassifiedParticle(v, 0u, 0.0, array<f32, 3>());
    }
}
