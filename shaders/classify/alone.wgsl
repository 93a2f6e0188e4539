// Particles are asked by themselves.

// Nothing is shared by the threads of a view.
fn prepare(view: BlockView, thread: u32) {
}

fn visit_shown(view: BlockView, thread: u32) -> Visit {
    return visit(view.block, thread);
}
