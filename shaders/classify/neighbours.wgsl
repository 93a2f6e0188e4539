// Drops particles that carry values if none of the values around is visible: slabs are classified, not
// particles. Twin: src/blocks/neighbours.rs.

// Loads the values around a brick.
fn prepare(view: BlockView, thread: u32) {
    if IS_LATTICE && view.classified_by == BY_NEIGHBOURS {
        fill_halo(view.block, thread);
    }
}

fn visit_shown(view: BlockView, thread: u32) -> Visit {
    var particle = visit(view.block, thread);
    if view.classified_by == BY_NEIGHBOURS && is_positive(particle.mass) {
        var around = vec2<f32>(0.0);
        if IS_LATTICE {
            around = range_around(thread);
        } else {
            let index = blocks[view.block].first + thread;
            around = model_of_point(index, value_at(index)).around;
        }
        // As `BEYOND` of the twin.
        let beyond = 0.25 * (around.y - around.x);
        around = vec2<f32>(around.x - beyond, around.y + beyond);
        var is_shown = false;
        let count = lobe_count();
        for (var i = 0u; i < count; i = i + 1u) {
            is_shown = is_shown || lobe_meets(lobe(i), around.x, around.y);
        }
        if !is_shown {
            particle.mass = 0.0;
        }
    }
    return particle;
}
