// Classifies each particle by its own value.

// The threads of a view share no data.
fn prepare(view: BlockView, thread: u32) {
}

fn visit_shown(view: BlockView, thread: u32) -> Visit {
    return visit(view.block, thread);
}
