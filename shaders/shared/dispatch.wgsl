// Returns the index of a workgroup: dispatches of more than MAX_GROUPS groups are folded into rows of
// MAX_GROUPS.
//
// It does not use the builtin num_workgroups, which DirectX does not provide for indirect dispatches.
fn group_index(group: vec3<u32>) -> u32 {
    return group.x + group.y * MAX_GROUPS;
}

// Returns the arguments of an indirect dispatch of at least `groups` workgroups.
fn folded(groups: u32) -> vec3<u32> {
    return vec3<u32>(min(groups, MAX_GROUPS), (groups + MAX_GROUPS - 1u) / MAX_GROUPS, 1u);
}
