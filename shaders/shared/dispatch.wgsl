// Which workgroup this is: dispatches of more than 65,535 are folded into rows.

fn group_index(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.x + group.y * groups.x;
}

// Workgroups along one dimension of a dispatch at most.
const MAX_GROUPS: u32 = 65535u;

// The arguments of an indirect dispatch of at least `groups` workgroups.
fn folded(groups: u32) -> vec3<u32> {
    return vec3<u32>(min(groups, MAX_GROUPS), (groups + MAX_GROUPS - 1u) / MAX_GROUPS, 1u);
}
