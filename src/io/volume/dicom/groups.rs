//! Finds attributes of a frame, which a file may state in several places.

use super::data_set::DataSet;
use super::tags::{self, Tag};

/// Sources of a frame's attributes: the frame's own group, the group shared by all frames, and the file.
pub(super) struct Groups<'s, 'b> {
    sets: [Option<&'s DataSet<'b>>; 2],
    pub(super) root: &'s DataSet<'b>,
}

impl<'s, 'b> Groups<'s, 'b> {
    pub(super) fn of(root: &'s DataSet<'b>, frame: usize) -> Self {
        let own = root.items(tags::PER_FRAME_GROUPS).get(frame);
        let shared = root.item(tags::SHARED_GROUPS);
        Self {
            sets: [own, shared],
            root,
        }
    }

    fn find<T>(&self, group: Tag, of: impl Fn(&'s DataSet<'b>) -> Option<T>) -> Option<T> {
        let sets = self.sets.into_iter().flatten();
        let grouped = sets.filter_map(|set| set.item(group)).find_map(&of);
        grouped.or_else(|| of(self.root))
    }

    pub(super) fn number(&self, group: Tag, tag: Tag) -> Option<f64> {
        self.find(group, |set| set.number(tag))
    }

    pub(super) fn text(&self, group: Tag, tag: Tag) -> Option<&'b str> {
        self.find(group, |set| set.text(tag))
    }

    pub(super) fn numbers_of<const N: usize>(&self, group: Tag, tag: Tag) -> Option<[f64; N]> {
        self.find(group, |set| set.numbers_of(tag))
    }
}
