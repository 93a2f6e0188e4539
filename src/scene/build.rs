//! Builds point volumes from arrays in memory.

use std::f64::consts::TAU;

use glam::{DMat3, DQuat, DVec3};

use crate::constants::DEFAULT_KERNEL_WIDTH;
use crate::error::{Error, Result};
use crate::math::{Variance, lower_factor, narrowed, principal_sigmas};
use crate::parallel;
use crate::scene::lattice::Lattice;
use crate::scene::point_volume::{Colour, Particles, PointVolume, Strength};
use crate::scene::transfer_function::TransferFunction;
use crate::scene::values::Values;

impl PointVolume {
    /// Spherical white kernels. Until masses or values are given, each has an optical depth of 1 along a line
    /// through its centre (other kernels: along their shortest axis).
    ///
    /// - `positions`: centres, world units.
    /// - `sigmas`: standard deviations, world units, one for each.
    ///
    /// ```
    /// use ewa_splat::scene::PointVolume;
    /// use ewa_splat::view::Camera;
    /// use ewa_splat::{Renderer, Settings};
    /// use glam::DVec3;
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// let stars = PointVolume::spheres([DVec3::ZERO, DVec3::X], [0.1, 0.2])
    ///     .with_colours([[1.0, 0.8, 0.3], [0.2, 0.4, 1.0]]);
    /// let camera = Camera::perspective(-5.0 * DVec3::Y, DVec3::ZERO, DVec3::Z, 40.0, [64, 48]);
    /// let mut renderer = Renderer::new(vec![stars])?;
    /// let image = renderer.render(&camera, &Settings::default())?;
    /// // 1 - exp(-1), less what the pixel's filter spreads.
    /// assert!((0.4..0.64).contains(&image.pixel(32, 24)[3]));
    /// # Ok(())
    /// # }
    /// ```
    pub fn spheres(positions: impl Into<Vec<DVec3>>, sigmas: impl Into<Vec<f32>>) -> Self {
        let particles = Particles::Isotropic {
            positions: positions.into(),
            sigmas: sigmas.into(),
        };
        Self::of_particles(particles)
    }

    /// Kernels with a variance matrix each; otherwise as [`PointVolume::spheres`].
    ///
    /// - `positions`: centres, world units.
    /// - `variances`: xx, xy, xz, yy, yz, zz of each, or matrices; world units squared. Flat kernels, with an
    ///   eigenvalue of 0, are allowed.
    ///
    /// ```
    /// use ewa_splat::scene::PointVolume;
    /// use glam::DVec3;
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// let positions: Vec<DVec3> = (0..10).map(|i| DVec3::X * f64::from(i)).collect();
    /// let discs = vec![[0.25, 0.0, 0.0, 0.25, 0.0, 0.01]; 10];
    /// let volume = PointVolume::ellipsoids(positions, &discs)?.with_masses(vec![0.5; 10]);
    /// assert_eq!(volume.particles.len(), 10);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// The first matrix that is no variance ([`Variance::factor`]).
    pub fn ellipsoids<V: Into<Variance> + Copy>(
        positions: impl Into<Vec<DVec3>>,
        variances: &[V],
    ) -> Result<Self> {
        let factor = |(i, &variance): (usize, &V)| {
            let factor = variance.into().factor();
            factor.map(|l| l.map(narrowed)).map_err(|e| numbered(e, i))
        };
        let factors = variances.iter().enumerate().map(factor);
        Ok(Self::of_particles(Particles::Anisotropic {
            positions: positions.into(),
            factors: factors.collect::<Result<_>>()?,
        }))
    }

    /// Kernels with standard deviations along axes of their own; otherwise as [`PointVolume::spheres`].
    ///
    /// - `scales`: standard deviations along x, y and z, world units.
    /// - `rotations`: rotations from x, y and z to the kernel's axes; of any length but zero.
    ///
    /// ```
    /// use ewa_splat::scene::PointVolume;
    /// use glam::{DQuat, DVec3};
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// let turn = DQuat::from_rotation_z(0.5);
    /// let needle = PointVolume::turned([DVec3::ZERO], &[DVec3::new(1.0, 0.1, 0.1)], &[turn])?;
    /// assert_eq!(needle.particles.len(), 1);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Scales that are negative, all 0 or not finite; a rotation of length zero; different numbers of scales
    /// and rotations.
    pub fn turned(
        positions: impl Into<Vec<DVec3>>,
        scales: &[DVec3],
        rotations: &[DQuat],
    ) -> Result<Self> {
        if scales.len() != rotations.len() {
            return Err(Error::invalid(
                "point volume",
                "rotations",
                format!("one for each of {} scales", scales.len()),
                rotations.len().to_string(),
                "give one for each",
            ));
        }
        let factor = |(i, (&scale, &rotation)): (usize, (&DVec3, &DQuat))| {
            let is_size = scale.is_finite() && scale.min_element() >= 0.0 && scale != DVec3::ZERO;
            let length = rotation.length();
            if !(is_size && length > 0.0 && length.is_finite()) {
                return Err(Error::invalid(
                    "point volume",
                    format!("kernel {i}"),
                    "scales from 0 up, one above, and a quaternion that is not 0",
                    format!("{scale} and {rotation}"),
                    "correct it, or leave it out",
                ));
            }
            let turn = DMat3::from_quat(rotation * (1.0 / length));
            Ok(lower_factor(turn * DMat3::from_diagonal(scale)).map(narrowed))
        };
        let factors = scales.iter().zip(rotations).enumerate().map(factor);
        Ok(Self::of_particles(Particles::Anisotropic {
            positions: positions.into(),
            factors: factors.collect::<Result<_>>()?,
        }))
    }

    /// A lattice of values, coloured by a transfer function. No positions are stored.
    ///
    /// - `values`: one per sample, x fastest, then y, then z.
    ///
    /// ```
    /// use ewa_splat::scene::{Lattice, PointVolume, TransferDefaults, TransferFunction};
    /// use glam::DVec3;
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// let values: Vec<f32> = (0..4 * 3 * 2).map(|i| i as f32).collect();
    /// let defaults = TransferDefaults { range: [0.0, 24.0], unit_distance: 1.0 };
    /// let viridis = TransferFunction::named("viridis", &defaults)?;
    /// let lattice = Lattice::uniform([4, 3, 2], DVec3::ZERO, DVec3::ONE);
    /// let volume = PointVolume::lattice(lattice, values, viridis);
    /// assert!(volume.validate().is_ok());
    /// # Ok(())
    /// # }
    /// ```
    pub fn lattice(
        lattice: Lattice,
        values: impl Into<Values>,
        transfer_function: TransferFunction,
    ) -> Self {
        let particles = Particles::Lattice {
            lattice,
            kernel_width: DEFAULT_KERNEL_WIDTH,
        };
        // Volumes follow from the index.
        let volumes = Vec::new();
        Self::new(particles, Strength::Classified { volumes })
            .classified(values.into(), transfer_function)
    }

    /// White particles with the given strength, without values, normals or a boundary.
    ///
    /// ```
    /// use ewa_splat::scene::{Particles, PointVolume, Strength};
    /// use glam::DVec3;
    ///
    /// let disc = Particles::Surfels {
    ///     positions: vec![DVec3::ZERO],
    ///     tangents: vec![[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]],
    ///     is_one_sided: false,
    /// };
    /// let volume = PointVolume::new(disc, Strength::Surface(vec![1.0]));
    /// assert!(volume.validate().is_ok());
    /// ```
    pub fn new(particles: Particles, strength: Strength) -> Self {
        Self {
            particles,
            strength,
            colour: Colour::Uniform([1.0; 3]),
            values: None,
            transfer_function: None,
            boundary: None,
            normals: None,
            local_models: None,
        }
    }

    fn of_particles(particles: Particles) -> Self {
        // tau = g / (2 pi s1 s2) along the third axis.
        let masses = sizes(&particles, |[s1, s2, _]| TAU * s1 * s2);
        Self::new(particles, Strength::Mass(masses))
    }

    /// Sets masses \[length²\], one per particle: extinction x volume.
    #[must_use]
    pub fn with_masses(mut self, masses: impl Into<Vec<f32>>) -> Self {
        self.strength = Strength::Mass(masses.into());
        self
    }

    /// Sets a linear RGB colour for each particle.
    #[must_use]
    pub fn with_colours(mut self, colours: impl Into<Vec<[f32; 3]>>) -> Self {
        self.colour = Colour::PerParticle(colours.into());
        self
    }

    /// Sets one linear RGB colour for all particles.
    #[must_use]
    pub fn with_colour(mut self, colour: [f32; 3]) -> Self {
        self.colour = Colour::Uniform(colour);
        self
    }

    /// Sets a value for each particle. The transfer function gives its colour and its extinction; extinction
    /// times the particle's volume is its mass. The volume is the cell for which such a kernel is made: the
    /// product of the standard deviations over [`DEFAULT_KERNEL_WIDTH`]³.
    ///
    /// Masses and colours set later replace those of the transfer function.
    ///
    /// ```
    /// use ewa_splat::scene::{PointVolume, TransferDefaults, TransferFunction};
    /// use glam::DVec3;
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// let defaults = TransferDefaults { range: [0.0, 1.0], unit_distance: 1.0 };
    /// let plasma = TransferFunction::named("plasma", &defaults)?;
    /// let volume = PointVolume::spheres([DVec3::ZERO, DVec3::X], [0.6, 0.6])
    ///     .with_values(vec![0.2, 0.9], plasma);
    /// assert!(volume.validate().is_ok());
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn with_values(
        mut self,
        values: impl Into<Values>,
        transfer_function: TransferFunction,
    ) -> Self {
        let width = DEFAULT_KERNEL_WIDTH.powi(3);
        let volumes = sizes(&self.particles, |sigmas| {
            sigmas.iter().product::<f64>() / width
        });
        self.strength = Strength::Classified { volumes };
        self.classified(values.into(), transfer_function)
    }

    /// Sets a value for each particle, and lets the transfer function give its colour. If the strength is
    /// classified too, the function gives its extinction.
    #[must_use]
    pub fn classified(mut self, values: Values, transfer_function: TransferFunction) -> Self {
        self.colour = Colour::Classified;
        self.values = Some(values);
        self.transfer_function = Some(transfer_function);
        self
    }
}

/// A number computed from each shape's principal standard deviations, greatest first; empty for a lattice.
fn sizes(particles: &Particles, of: impl Fn([f64; 3]) -> f64 + Sync) -> Vec<f32> {
    let wide = |shape: &[f32; 6]| shape.map(f64::from);
    match particles {
        Particles::Lattice { .. } => Vec::new(),
        Particles::Isotropic { sigmas, .. } => {
            let size = |&sigma: &f32| narrowed(of([f64::from(sigma); 3]));
            parallel::map(sigmas.len(), |i| size(&sigmas[i]))
        }
        Particles::Anisotropic { factors, .. } => {
            let size = |l: &[f32; 6]| narrowed(of(principal_sigmas(wide(l))));
            parallel::map(factors.len(), |i| size(&factors[i]))
        }
        Particles::Surfels { tangents, .. } => {
            let size = |t: &[f32; 6]| {
                let [ax, ay, az, bx, by, bz] = wide(t);
                let (a, b) = (DVec3::new(ax, ay, az), DVec3::new(bx, by, bz));
                let flat = DMat3::from_cols(a, b, DVec3::ZERO);
                narrowed(of(principal_sigmas(lower_factor(flat))))
            };
            parallel::map(tangents.len(), |i| size(&tangents[i]))
        }
    }
}

/// Adds a matrix's number to its error.
fn numbered(error: Error, i: usize) -> Error {
    match error {
        Error::Invalid {
            expected,
            found,
            advice,
            ..
        } => Error::invalid(
            "point volume",
            format!("variance {i}"),
            expected,
            found,
            advice,
        ),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_shape_three_ways() {
        let (at, turn) = (DVec3::new(1.0, 2.0, 3.0), DQuat::from_rotation_x(0.7));
        let scales = DVec3::new(0.5, 0.2, 0.1);
        let f = DMat3::from_quat(turn) * DMat3::from_diagonal(scales);
        let v = f * f.transpose();
        let elements = [
            v.x_axis.x, v.x_axis.y, v.x_axis.z, v.y_axis.y, v.y_axis.z, v.z_axis.z,
        ];
        let turned = PointVolume::turned([at], &[scales], &[turn * 3.0]).unwrap();
        let by_elements = PointVolume::ellipsoids([at], &[elements]).unwrap();
        let by_matrix = PointVolume::ellipsoids([at], &[v]).unwrap();
        assert_eq!(by_elements, by_matrix);
        let factors = |volume: &PointVolume| match &volume.particles {
            Particles::Anisotropic { factors, .. } => factors[0],
            other => panic!("{other:?}"),
        };
        for (a, b) in factors(&turned).iter().zip(factors(&by_matrix)) {
            // Cholesky's recurrence on squares, in f64: no more than one rounding of f32.
            assert!((a - b).abs() <= 1e-7 * 0.5, "{a} {b}");
        }
        // The depth along the third axis is 1: g = 2 pi 0.5 0.2, the cell 0.01 / 0.6³.
        let strength = |volume: &PointVolume| f64::from(volume.strength.stored()[0]);
        assert!((strength(&turned) - TAU * 0.1).abs() < 1e-6);
        let defaults = crate::scene::TransferDefaults {
            range: [0.0, 1.0],
            unit_distance: 1.0,
        };
        let viridis = TransferFunction::named("viridis", &defaults).unwrap();
        let classified = turned.with_values(vec![0.5], viridis);
        assert!((strength(&classified) - 0.01 / 0.216).abs() < 1e-6);
        assert!(classified.validate().is_ok());
        // Masses set later replace those of the transfer function.
        let masses = classified.with_masses([2.0]);
        assert_eq!(
            (masses.strength.stored(), &masses.colour),
            (&[2.0][..], &Colour::Classified)
        );
    }

    #[test]
    fn what_is_no_shape_is_refused() {
        let at = [DVec3::ZERO; 2];
        let sound = [0.25, 0.0, 0.0, 0.25, 0.0, 0.01];
        for poison in [
            [0.0; 6],
            [1.0, 2.0, 0.0, 1.0, 0.0, 1.0],
            [1.0, 0.0, 0.0, -1.0, 0.0, 1.0],
            [f64::NAN, 0.0, 0.0, 1.0, 0.0, 1.0],
            [f64::INFINITY, 0.0, 0.0, 1.0, 0.0, 1.0],
        ] {
            let error = PointVolume::ellipsoids(at, &[sound, poison])
                .unwrap_err()
                .to_string();
            assert!(error.contains("variance 1"), "{error}");
        }
        let skew = DMat3::from_cols(DVec3::X, DVec3::new(0.5, 1.0, 0.0), DVec3::Z);
        assert!(PointVolume::ellipsoids(at, &[skew]).is_err());
        let turn = DQuat::IDENTITY;
        for (scale, turn) in [
            (DVec3::ZERO, turn),
            (DVec3::NEG_ONE, turn),
            (DVec3::NAN, turn),
            (DVec3::ONE, turn * 0.0),
            (DVec3::ONE, turn * f64::NAN),
        ] {
            assert!(PointVolume::turned([DVec3::ZERO], &[scale], &[turn]).is_err());
        }
        assert!(PointVolume::turned(at, &[DVec3::ONE; 2], &[turn]).is_err());
        // Arrays of unequal lengths are found when the volume is used.
        assert!(PointVolume::spheres(at, [1.0]).validate().is_err());
        assert!(
            PointVolume::ellipsoids(at, &[sound])
                .unwrap()
                .validate()
                .is_err()
        );
        assert!(
            PointVolume::spheres(at, [1.0; 2])
                .with_masses([1.0])
                .validate()
                .is_err()
        );
    }
}
