//! Extension records of SPZ files, which are kept for files that are written as SPZ again.

/// Type of the record `SPZ_ADOBE_safe_orbit_camera`: least and greatest elevation, least distance.
const SAFE_ORBIT: u32 = 0xADBE_0002;

/// Records that a note names, at most.
const MOST_NAMED: usize = 4;

/// One extension record of an SPZ file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SpzRecord {
    /// Type: the vendor in the upper 16 bits, the vendor's number of the extension in the lower ones.
    pub kind: u32,
    /// Contents, which are not interpreted.
    pub payload: Vec<u8>,
}

/// Extension records of the SPZ file that splats were read from, in its order. The record of the file's axes is not among
/// them, because readers convert the axes.
///
/// Contents are unknown. They may refer to splats by number, or to places. A record is thus kept only while the splats and their
/// coordinates are those of the file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SpzRecords {
    kept: Vec<SpzRecord>,
    /// Types of records that no longer hold, and why.
    lost: Vec<(u32, Change)>,
}

/// A change of splats after which records may no longer hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Change {
    /// Coordinates in other axes; what is up stays up.
    Axes,
    /// Splats left out, merged, or made anew.
    Splats,
    /// Splats resized, rotated or translated.
    Places,
    /// Splats of several files together.
    Joined,
}

impl Change {
    /// Whether records of a type hold after the change.
    fn keeps(self, kind: u32) -> bool {
        // A camera's limits belong to the scene, not to a splat or an axis.
        kind == SAFE_ORBIT && matches!(self, Self::Axes | Self::Splats)
    }

    fn reason(self) -> &'static str {
        match self {
            Self::Axes => "its file has other axes",
            Self::Splats => "the splats are not those of its file",
            Self::Places => "the splats are resized, turned or moved",
            Self::Joined => "the splats are those of several files",
        }
    }
}

impl SpzRecords {
    /// Returns records as a file stores them.
    pub fn new(kept: Vec<SpzRecord>) -> Self {
        let lost = Vec::new();
        Self { kept, lost }
    }

    /// Returns the records that still hold.
    pub fn kept(&self) -> &[SpzRecord] {
        &self.kept
    }

    /// Removes the records that do not hold after a change.
    pub(crate) fn change(&mut self, change: Change) {
        let lost = self
            .kept
            .extract_if(.., |record| !change.keeps(record.kind));
        self.lost.extend(lost.map(|record| (record.kind, change)));
    }

    /// Appends the records of splats that are appended.
    pub(crate) fn join(&mut self, mut other: Self) {
        self.lost.append(&mut other.lost);
        self.kept.append(&mut other.kept);
        self.change(Change::Joined);
    }

    /// Returns notes on the records that a file does not get.
    ///
    /// - `is_spz`: whether it can have some.
    pub(crate) fn notes(&self, is_spz: bool) -> Vec<String> {
        let left_out = |kinds: &[u32], reason: &str| {
            let (records, are) = match kinds {
                [_] => ("extension record", "is"),
                _ => ("extension records", "are"),
            };
            let named = named(kinds.iter().map(|kind| format!("{kind:#010x}")));
            format!("SPZ's {records} {named} {are} left out: {reason}")
        };
        let mut notes = Vec::new();
        for change in [Change::Axes, Change::Splats, Change::Places, Change::Joined] {
            let of_it = self.lost.iter().filter(|(_, of)| *of == change);
            let kinds: Vec<u32> = of_it.map(|(kind, _)| *kind).collect();
            if !kinds.is_empty() {
                notes.push(left_out(&kinds, change.reason()));
            }
        }
        if !is_spz && !self.kept.is_empty() {
            let kinds: Vec<u32> = self.kept.iter().map(|record| record.kind).collect();
            notes.push(left_out(&kinds, "the format has none"));
        }
        notes
    }

    /// Returns a note on the records as they were read, if there are any.
    ///
    /// - `is_kept`: whether they are kept.
    pub(crate) fn note(&self, is_kept: bool) -> Option<String> {
        let each = self.kept.iter();
        let each =
            each.map(|record| format!("{:#010x} ({} bytes)", record.kind, record.payload.len()));
        let treated = match is_kept {
            true => "not used, but kept for SPZ files",
            false => "not used",
        };
        let is_some = !self.kept.is_empty();
        is_some.then(|| format!("SPZ's extension records are {treated}: {}", named(each)))
    }
}

/// Lists the first names, and the number of the others.
fn named(names: impl ExactSizeIterator<Item = String>) -> String {
    let others = names.len().saturating_sub(MOST_NAMED);
    let mut first: Vec<String> = names.take(MOST_NAMED).collect();
    if others > 0 {
        first.push(format!("and {others} more"));
    }
    first.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> SpzRecords {
        let record = |kind| SpzRecord {
            kind,
            payload: vec![1, 2, 3],
        };
        SpzRecords::new(vec![record(0x1234_0001), record(SAFE_ORBIT)])
    }

    fn kinds(records: &SpzRecords) -> Vec<u32> {
        records.kept().iter().map(|record| record.kind).collect()
    }

    #[test]
    fn records_hold_as_far_as_is_known() {
        for (change, expected) in [
            (Change::Axes, vec![SAFE_ORBIT]),
            (Change::Splats, vec![SAFE_ORBIT]),
            (Change::Places, vec![]),
            (Change::Joined, vec![]),
        ] {
            let mut records = some();
            records.change(change);
            assert_eq!(kinds(&records), expected, "{change:?}");
            let [note] = records.notes(true).try_into().unwrap();
            assert!(
                note.contains("0x12340001") && note.ends_with(change.reason()),
                "{note}"
            );
        }
        assert_eq!(some().notes(true), <[String; 0]>::default());
        let [note] = some().notes(false).try_into().unwrap();
        let expected =
            "SPZ's extension records 0x12340001, 0xadbe0002 are left out: the format has none";
        assert_eq!(note, expected);
    }

    #[test]
    fn notes_name_a_few() {
        let record = |kind| SpzRecord {
            kind,
            payload: Vec::new(),
        };
        let records = SpzRecords::new((1..=9).map(record).collect());
        let note = records.note(true).unwrap();
        assert!(note.ends_with("0x00000004 (0 bytes), and 5 more"), "{note}");
        assert_eq!(SpzRecords::default().note(true), None);
    }
}
