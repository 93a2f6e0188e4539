//! Lists the variants of a sweep: every approximation with its choices, one line each.

use crate::constants::MAX_CUTOFF;
use crate::cpu::SimdLevel;
use crate::render::{Advanced, Composite, Settings, Show};
use crate::scene::Classification;
use crate::splat::Filter;

/// One combination of settings for drawing the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Name that stays the same between versions: `filter-ewa`.
    pub id: String,
    /// Description for people: `affine footprints everywhere`.
    pub label: String,
    /// Description in a few letters, for a plot.
    pub mark: String,
    /// Setting that is varied: `tolerance`, `filter`, ...
    pub group: &'static str,
    /// Settings for drawing.
    pub settings: Settings,
    /// Width over spacing of the kernels, for a scene that is sampled again.
    pub kernel_width: Option<f64>,
}

impl Variant {
    /// Returns true if the variant aims at another image than the reference: kernels or pixels are filtered, or
    /// kernels classified, in another way. Its error then results from a choice and is no fault.
    pub fn changes_signal(&self, default: &Settings) -> bool {
        self.kernel_width.is_some()
            || self.settings.classify != default.classify
            || self.settings.classifies_slabs() != default.classifies_slabs()
            || self.changes_pixels(default)
    }

    /// Returns true if pixels are filtered in another way: that changes the image of the data, too.
    pub fn changes_pixels(&self, default: &Settings) -> bool {
        let variance = |settings: &Settings| settings.low_pass_variance_px2.to_bits();
        variance(&self.settings) != variance(default)
    }
}

/// Tolerances with their usual notation.
const TOLERANCES: [(&str, f32); 8] = [
    ("1/4", 1.0 / 4.0),
    ("1/8", 1.0 / 8.0),
    ("1/16", 1.0 / 16.0),
    ("1/64", 1.0 / 64.0),
    ("1/255", 1.0 / 255.0),
    ("1e-3", 1e-3),
    ("3e-4", 3e-4),
    ("1e-4", 1e-4),
];

const CUTOFFS: [f32; 7] = [1.5, 2.0, 2.5, 3.0, 3.33, 4.0, 5.0];
const LOW_PASS_VARIANCES_PX2: [f32; 6] = [0.1, 0.15, 0.25, 0.5, 1.0, 2.0];
const KERNEL_WIDTHS: [f64; 5] = [0.5, 0.55, 0.6, 0.7, 0.8];

/// Id of the variant with the given settings.
pub const DEFAULT: &str = "default";
/// Id of the most accurate variant.
pub const ACCURATE: &str = "accurate";
/// Id of the most accurate variant with kernels sliced into slabs.
const ACCURATE_SLABS: &str = "accurate-slabs";
/// Id of a variant that saves time wherever that is tolerable.
pub const FAST: &str = "fast";

/// c_min and c_max of Chen et al. 2004, section 4.1. The latter lacks its factor of the field of view, which
/// [`Advanced::thresholds`] includes.
pub const PAPER_THRESHOLDS: [f32; 2] = [0.3, 2.0];

/// Returns the settings of the most accurate splatting on the CPU: exact footprints of every particle, cut off
/// at 7 standard deviations, at a tolerance of 1e-4.
pub fn accurate(base: &Settings) -> Settings {
    Settings {
        filter: Filter::Exact,
        advanced: Advanced {
            thresholds: None,
            linear_opacity: false,
            ..base.advanced
        },
        level_of_detail: false,
        show: Show::Scene,
        tolerance: 1e-4,
        cutoff: Some(MAX_CUTOFF),
        ..base.clone()
    }
}

/// Sets a composite whose kernels are classified, not its slabs.
fn composited(settings: &mut Settings, composite: Composite) {
    settings.composite = composite;
    if settings.classify == Classification::Slab {
        settings.classify = Classification::default();
    }
}

/// Returns all variants. Each changes one setting of `base`, except in the group `together`. Variants equal to
/// `base` are left out.
///
/// - `kernel_width`: width of the scene's kernels over spacing, if the scene can be sampled with another.
pub fn variants(base: &Settings, kernel_width: Option<f64>) -> Vec<Variant> {
    let mut list = List::new(base);
    list.push("as given", DEFAULT, "default settings", "default", |_| {});
    list.push(
        "together",
        ACCURATE,
        "exact, tolerance 1e-4, cut-off 7",
        "accurate",
        |s| *s = accurate(s),
    );
    list.push(
        "together",
        FAST,
        "affine, tolerance 1/16, linear opacity",
        "fast",
        |s| {
            s.filter = Filter::Ewa;
            s.tolerance = 1.0 / 16.0;
            s.advanced.linear_opacity = true;
        },
    );
    list.push(
        "together",
        ACCURATE_SLABS,
        "the same in slabs",
        "accurate slabs",
        |s| {
            *s = accurate(s);
            composited(s, Composite::SLABS);
        },
    );
    for (name, tolerance) in TOLERANCES {
        let id = format!("tolerance-{}", name.replace('/', "-"));
        list.push("tolerance", &id, &format!("tolerance {name}"), name, |s| {
            s.tolerance = tolerance;
        });
    }
    for filter in Filter::ALL {
        let name = filter.name();
        let id = format!("filter-{name}");
        list.push("filter", &id, filter_label(filter), name, |s| {
            s.filter = filter;
        });
    }
    let thresholds = PAPER_THRESHOLDS;
    list.push(
        "filter",
        "filter-thresholds",
        &thresholds_label(thresholds),
        "Chen's c_min, c_max",
        |s| {
            s.filter = Filter::Adaptive;
            s.advanced.thresholds = Some(thresholds);
        },
    );
    for (name, label, mark, is_on) in [
        ("auto", "particles far below a pixel merged", "merged", true),
        ("off", "no particles merged", "none merged", false),
    ] {
        let id = format!("level-of-detail-{name}");
        list.push("level of detail", &id, label, mark, |s| {
            s.level_of_detail = is_on;
        });
    }
    for r in CUTOFFS {
        let label = format!("cut-off at {r} standard deviations");
        let id = format!("cutoff-{r}");
        list.push("cut-off", &id, &label, &format!("{r} σ"), |s| {
            s.cutoff = Some(r);
        });
    }
    for composite in Composite::ALL {
        let name = composite.name();
        let id = format!("composite-{name}");
        list.push("composite", &id, composite_label(composite), name, |s| {
            composited(s, composite);
        });
    }
    for (name, label, classify) in [
        (
            "particle",
            "particles classified at their values",
            Classification::Particle,
        ),
        (
            "extent",
            "kernels classified over their extents",
            Classification::Extent,
        ),
    ] {
        let id = format!("classify-{name}");
        list.push("classification", &id, label, name, |s| {
            s.classify = classify;
        });
    }
    for (name, linear) in [("exponential", false), ("linear", true)] {
        let id = format!("opacity-{name}");
        list.push("opacity", &id, &format!("{name} opacity"), name, |s| {
            s.advanced.linear_opacity = linear;
        });
    }
    for variance in LOW_PASS_VARIANCES_PX2 {
        let label = format!("low-pass variance {variance} px²");
        let id = format!("low-pass-{variance}");
        list.push("low-pass", &id, &label, &format!("{variance} px²"), |s| {
            s.low_pass_variance_px2 = variance;
        });
    }
    for simd in SimdLevel::available() {
        let name = simd_name(simd);
        let id = format!("simd-{}", name.to_lowercase());
        list.push(
            "instructions",
            &id,
            &format!("{name} instructions"),
            name,
            |s| {
                s.advanced.simd = simd;
            },
        );
    }
    let mut list = list.variants;
    if let Some(current) = kernel_width {
        let others = KERNEL_WIDTHS
            .iter()
            .filter(|&&w| w.to_bits() != current.to_bits());
        list.extend(others.map(|&width| Variant {
            id: format!("kernel-width-{width}"),
            label: format!("kernel width {width} of the spacing"),
            mark: format!("ρ {width}"),
            group: "kernel width",
            settings: base.clone(),
            kernel_width: Some(width),
        }));
    }
    list
}

/// Returns the variants for a single volume with a field: the transfer function is applied to the mean value of
/// each slab.
pub(super) fn post_classified(base: &Settings) -> Vec<Variant> {
    let mut list = List::new(base);
    list.push(
        "classification",
        "post-classification",
        "slabs classified by their mean values",
        "slabs",
        |s| {
            s.composite = Composite::SLABS;
            s.classify = Classification::Slab;
        },
    );
    list.variants
}

/// Returns the error budget's approximations: each alone against the [`accurate`] settings.
pub fn budget_variants(base: &Settings) -> Vec<Variant> {
    let mut list = List::new(&accurate(base));
    list.push(
        "budget",
        "budget-tolerance",
        "cut-off and early stop as the tolerance says",
        "",
        |s| {
            s.tolerance = base.tolerance;
            s.cutoff = None;
        },
    );
    list.push("budget", "budget-cutoff-3", "cut-off at 3 σ", "", |s| {
        s.cutoff = Some(3.0);
    });
    list.push(
        "budget",
        "budget-opacity-linear",
        "linear opacity",
        "",
        |s| {
            s.advanced.linear_opacity = true;
        },
    );
    for filter in Filter::ALL {
        let id = format!("budget-filter-{}", filter.name());
        list.push("budget", &id, filter_label(filter), "", |s| {
            s.filter = filter;
        });
    }
    let thresholds = PAPER_THRESHOLDS;
    list.push(
        "budget",
        "budget-filter-thresholds",
        &thresholds_label(thresholds),
        "",
        |s| {
            s.filter = Filter::Adaptive;
            s.advanced.thresholds = Some(thresholds);
        },
    );
    list.push(
        "budget",
        "budget-default",
        "everything at its default",
        "",
        |s| *s = base.clone(),
    );
    list.variants
}

/// Describes a filter; its name if it has no description here.
fn filter_label(filter: Filter) -> &'static str {
    let words = [
        (
            Filter::Adaptive,
            "affine footprints where the tolerance allows",
        ),
        (Filter::Exact, "exact footprints everywhere"),
        (Filter::Ewa, "affine footprints everywhere"),
        (
            Filter::Reconstruction,
            "no low-pass filter (reconstruction only)",
        ),
        (Filter::LowPass, "no reconstruction kernel (low-pass only)"),
        (Filter::Isotropic, "round footprints"),
        (Filter::UniformScaling, "kernels enlarged (uniform scaling)"),
    ];
    words
        .iter()
        .find(|(of, _)| *of == filter)
        .map_or(filter.name(), |(_, words)| words)
}

fn composite_label(composite: Composite) -> &'static str {
    match composite {
        Composite::Over => "kernels one by one",
        Composite::Sheets { .. } => "whole kernels summed in sheets along the view",
        Composite::AxisSheets { .. } => "whole kernels summed in sheets along an axis",
        Composite::Slabs { .. } => "kernels sliced into slabs",
        Composite::Maximum { .. } => "the greatest value along each ray",
    }
}

fn thresholds_label([c_min, c_max]: [f32; 2]) -> String {
    format!("thresholds of Chen et al. 2004, {c_min} and {c_max:.2}")
}

pub(super) fn simd_name(level: SimdLevel) -> &'static str {
    match level {
        SimdLevel::Baseline => "Baseline",
        SimdLevel::Avx2 => "AVX2",
        SimdLevel::Avx512 => "AVX-512",
    }
}

struct List {
    base: Settings,
    variants: Vec<Variant>,
}

impl List {
    fn new(base: &Settings) -> Self {
        Self {
            base: base.clone(),
            variants: Vec::new(),
        }
    }

    fn push(
        &mut self,
        group: &'static str,
        id: &str,
        label: &str,
        mark: &str,
        change: impl FnOnce(&mut Settings),
    ) {
        let mut settings = self.base.clone();
        change(&mut settings);
        if id != DEFAULT && settings == self.base {
            return;
        }
        self.variants.push(Variant {
            id: id.into(),
            label: label.into(),
            mark: mark.into(),
            group,
            settings,
            kernel_width: None,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_unique_and_every_filter_is_tried() {
        let base = Settings::default();
        let all = variants(&base, Some(0.6));
        let mut ids: Vec<&str> = all.iter().map(|v| v.id.as_str()).collect();
        let budget = budget_variants(&base);
        ids.extend(budget.iter().map(|v| v.id.as_str()));
        let count = ids.len();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), count);
        for filter in Filter::ALL {
            assert!(all.iter().any(|v| v.settings.filter == filter));
        }
        for composite in Composite::ALL {
            assert!(all.iter().any(|v| v.settings.composite == composite));
        }
        for id in [DEFAULT, ACCURATE, ACCURATE_SLABS, FAST] {
            assert!(ids.contains(&id));
        }
    }

    #[test]
    fn each_is_tried_once_and_what_changes_the_signal_says_so() {
        let base = Settings::default();
        let all = variants(&base, Some(0.6));
        for (i, a) in all.iter().enumerate() {
            for b in &all[..i] {
                assert!(
                    a.settings != b.settings || a.kernel_width != b.kernel_width,
                    "{} and {}",
                    a.id,
                    b.id
                );
            }
            let changes = ["kernel width", "low-pass", "classification"].contains(&a.group);
            assert_eq!(a.changes_signal(&base), changes, "{}", a.id);
            assert_eq!(a.changes_pixels(&base), a.group == "low-pass", "{}", a.id);
        }
        assert!(
            variants(&base, None)
                .iter()
                .all(|v| v.kernel_width.is_none())
        );
    }
}
