// Which workgroup this is: dispatches of more than MAX_GROUPS are folded into rows of as many.
//
// Not by the builtin num_workgroups, which DirectX does not know of indirect dispatches.
fn group_index(group: vec3<u32>) -> u32 {
    return group.x + group.y * MAX_GROUPS;
}

// The arguments of an indirect dispatch of at least `groups` workgroups.
fn folded(groups: u32) -> vec3<u32> {
    return vec3<u32>(min(groups, MAX_GROUPS), (groups + MAX_GROUPS - 1u) / MAX_GROUPS, 1u);
}
