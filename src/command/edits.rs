//! Defines the options that place inputs and crop them to boxes.

use crate::edit::{Displacement, Placement};
use crate::load::Edit;
use crate::{Error, Result};
use clap::Args;
use glam::{DQuat, DVec3};

use super::parse::{self, OrNone};

/// Each option holds for all inputs, or is given once for each of them.
#[derive(Args)]
#[command(next_help_heading = "Placement")]
pub(crate) struct EditOptions {
    /// Move points by a vector field at points, times F (default 1), before all else: the deformed shape of a structure
    #[arg(long, value_name = "NAME[,F]", value_parser = parse::or_none(parse::displacement))]
    displace: Vec<OrNone<Displacement>>,
    /// Make everything F times as large, about the origin, or by three factors (1,1,50 exaggerates heights); --rotate
    /// and then --translate follow. Given once, each option here is for all inputs; else once for each in their order,
    /// with `none` for those it leaves alone
    #[arg(long, value_name = "F|x,y,z", value_parser = parse::or_none(parse::sizes), allow_hyphen_values = true)]
    resize: Vec<OrNone<DVec3>>,
    /// Multiply heights by F, along what is up in the data, beside --resize
    #[arg(long, value_name = "F", value_parser = parse::or_none(parse::positive), allow_hyphen_values = true)]
    exaggerate: Vec<OrNone<f64>>,
    /// Turn by an angle about an axis through the origin, right-handed; vectors turn, too
    #[arg(long, value_name = "x,y,z,DEGREES", value_parser = parse::or_none(parse::turn), allow_hyphen_values = true)]
    rotate: Vec<OrNone<DQuat>>,
    /// Move by a vector
    #[arg(long, value_name = "x,y,z", value_parser = parse::or_none(parse::vector), allow_hyphen_values = true)]
    translate: Vec<OrNone<DVec3>>,
    /// Take what lies in a box alone, in the coordinates that the options above lead to
    #[arg(long, value_name = "x0,y0,z0,x1,y1,z1", value_parser = parse::or_none(parse::corners),
          allow_hyphen_values = true)]
    crop: Vec<OrNone<[DVec3; 2]>>,
}

impl EditOptions {
    /// Returns true if any input is turned.
    pub(crate) fn turns(&self) -> bool {
        !self.rotate.is_empty()
    }

    /// Returns the edits of each of `count` inputs.
    ///
    /// # Errors
    /// An option that is given neither once nor once for each input.
    pub(crate) fn of_inputs(&self, count: usize) -> Result<Vec<Edit>> {
        let displace = of_each("--displace", &self.displace, count)?;
        let resize = of_each("--resize", &self.resize, count)?;
        let exaggerate = of_each("--exaggerate", &self.exaggerate, count)?;
        let rotate = of_each("--rotate", &self.rotate, count)?;
        let translate = of_each("--translate", &self.translate, count)?;
        let crop = of_each("--crop", &self.crop, count)?;
        let none = Placement::default();
        let edit = |i: usize| {
            let placement = Placement {
                size: resize(i).unwrap_or(none.size),
                rotation: rotate(i).unwrap_or(none.rotation),
                translation: translate(i).unwrap_or(none.translation),
            };
            Edit {
                displacement: displace(i),
                placement: (placement != none).then_some(placement),
                exaggeration: exaggerate(i),
                crop: crop(i),
            }
        };
        Ok((0..count).map(edit).collect())
    }
}

/// Returns a function from an input's number to the option's value for it.
fn of_each<'a, T: Clone>(
    option: &'static str,
    stated: &'a [OrNone<T>],
    count: usize,
) -> Result<impl Fn(usize) -> Option<T> + 'a> {
    if stated.len() > 1 && stated.len() != count {
        let inputs = if count == 1 { "input" } else { "inputs" };
        return Err(Error::invalid(
            option,
            "use",
            format!("once for all, or once for each of {count} {inputs}"),
            format!("{} times", stated.len()),
            "give it once, or for each input; `none` skips one",
        ));
    }
    Ok(move |i: usize| match stated {
        [] => None,
        [all] => all.0.clone(),
        each => each[i].0.clone(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_for_all_inputs_or_one_for_each() {
        let of = |resize: &[Option<f64>], count| {
            let options = EditOptions {
                displace: Vec::new(),
                resize: resize
                    .iter()
                    .map(|size| OrNone(size.map(DVec3::splat)))
                    .collect(),
                exaggerate: Vec::new(),
                rotate: Vec::new(),
                translate: Vec::new(),
                crop: Vec::new(),
            };
            let sizes = |edit: Edit| edit.placement.map(|placement| placement.size.x);
            let edits = options.of_inputs(count).ok()?;
            Some(edits.into_iter().map(sizes).collect::<Vec<_>>())
        };
        let (two, three) = (Some(2.0), Some(3.0));
        assert_eq!(of(&[], 2), Some(vec![None, None]));
        assert_eq!(of(&[two], 2), Some(vec![two, two]));
        assert_eq!(of(&[two, three], 2), Some(vec![two, three]));
        assert_eq!(of(&[None, three], 2), Some(vec![None, three]));
        assert_eq!(of(&[two, three], 3), None);
        assert_eq!(of(&[two, three], 1), None);
    }
}
