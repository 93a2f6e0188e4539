//! Tests particles in any partition: each rank brings some, and the picture is that of all of them
//! in their order.

use ewa_splat::distributed::{Collective, Renderer, Share};
use ewa_splat::scene::{
    Boundary, BoundaryPlanes, Colour, Particles, PointVolume, Strength, Values,
};
use ewa_splat::view::Camera;
use ewa_splat::{Error, SceneOptions, Settings};
use glam::DVec3;

use crate::common::Random;
use crate::ranks::{Frame, SIZES, alone, drawn, each};
use crate::scenes::{ball, ellipsoids, lattice, spheres};

/// Returns some particles of a volume.
pub(crate) fn taken(volume: &PointVolume, order: &[u32]) -> PointVolume {
    fn pick<T: Copy>(entries: &[T], order: &[u32]) -> Vec<T> {
        order.iter().map(|&i| entries[i as usize]).collect()
    }
    let particles = match &volume.particles {
        Particles::Isotropic { positions, sigmas } => Particles::Isotropic {
            positions: pick(positions, order),
            sigmas: pick(sigmas, order),
        },
        Particles::Anisotropic { positions, factors } => Particles::Anisotropic {
            positions: pick(positions, order),
            factors: pick(factors, order),
        },
        Particles::Surfels {
            positions,
            tangents,
            is_one_sided,
        } => Particles::Surfels {
            positions: pick(positions, order),
            tangents: pick(tangents, order),
            is_one_sided: *is_one_sided,
        },
        Particles::Lattice { .. } => return volume.clone(),
    };
    let strength = match &volume.strength {
        Strength::Classified { volumes } => Strength::Classified {
            volumes: pick(volumes, order),
        },
        Strength::Mass(masses) => Strength::Mass(pick(masses, order)),
        Strength::Surface(areas) => Strength::Surface(pick(areas, order)),
        other => panic!("{other:?}"),
    };
    let boundary = match &volume.boundary {
        Some(Boundary::Planes(planes)) => {
            let mut own = BoundaryPlanes::default();
            for &i in order {
                let word = planes.of_particle[i as usize];
                if word > 0 {
                    own.edges.push(planes.edges[word as usize - 1]);
                    own.of_particle.push(own.edges.len() as u32);
                } else {
                    own.of_particle.push(0);
                }
            }
            Some(Boundary::Planes(own))
        }
        other => other.clone(),
    };
    PointVolume {
        particles,
        strength,
        colour: match &volume.colour {
            Colour::PerParticle(colours) => Colour::PerParticle(pick(colours, order)),
            other => other.clone(),
        },
        values: volume.values.as_ref().map(|values| match values {
            Values::F32(values) => Values::F32(pick(values, order)),
            Values::U8(values) => Values::U8(pick(values, order)),
            other => panic!("{other:?}"),
        }),
        transfer_function: volume.transfer_function.clone(),
        boundary,
        normals: volume.normals.as_ref().map(|normals| pick(normals, order)),
        local_models: volume.local_models.as_ref().map(|m| m.gather(order)),
    }
}

/// Function that assigns a particle to a rank.
type Deal = fn(usize, usize, &mut Random) -> usize;

const DEALS: [Deal; 4] = [
    |i, ranks, _| i % ranks,
    |_, ranks, random| random.index(ranks),
    // All particles are on one rank; the others are empty.
    |_, ranks, _| ranks - 1,
    // The shares are uneven, and some are empty.
    |i, ranks, _| (i / 1000).min(ranks - 1),
];

/// Returns the particles of a volume that each rank has, in an order of their own.
fn dealt(count: usize, ranks: usize, deal: Deal) -> Vec<Vec<u32>> {
    let mut random = Random::new(ranks as u64);
    let mut orders = vec![Vec::new(); ranks];
    for i in 0..count {
        orders[deal(i, ranks, &mut random)].push(i as u32);
    }
    for order in &mut orders {
        for i in (1..order.len()).rev() {
            order.swap(i, random.index(i + 1));
        }
    }
    orders
}

fn shared(scene: &[PointVolume], orders: &[Vec<Vec<u32>>], rank: usize) -> Share {
    let own = scene.iter().zip(orders);
    Share {
        volumes: own.clone().map(|(v, of)| taken(v, &of[rank])).collect(),
        numbers: Some(
            own.map(|(_, of)| of[rank].iter().map(|&i| i.into()).collect())
                .collect(),
        ),
        planes: None,
    }
}

fn frames() -> Vec<(Camera, Settings)> {
    let camera = |eye, fov| Camera::perspective(eye, DVec3::ZERO, DVec3::Y, fov, [100, 80]);
    let settings = Settings {
        depth: true,
        ..Settings::default()
    };
    vec![
        (camera(DVec3::NEG_Z * 4.0, 40.0), settings.clone()),
        (camera(DVec3::X * 400.0, 20.0), settings),
    ]
}

fn assert_same_of_shares(scene: &[PointVolume], sizes: &[usize]) -> Vec<Frame> {
    let expected = alone(scene, &frames());
    for &size in sizes {
        for (d, deal) in DEALS.iter().enumerate() {
            let orders = scene.iter().map(|v| dealt(v.particles.len(), size, *deal));
            let orders: Vec<_> = orders.collect();
            let found = each(size, |rank| {
                let share = shared(scene, &orders, rank.rank());
                let renderer = Renderer::new(rank, share, &SceneOptions::default()).unwrap();
                drawn(renderer, &frames()).0
            });
            for (n, (found, expected)) in found[0].iter().zip(&expected).enumerate() {
                assert_eq!(
                    found.counts, expected.counts,
                    "frame {n}, {size} ranks, deal {d}"
                );
                assert!(found == expected, "frame {n}, {size} ranks, deal {d}");
            }
            assert_eq!(found[0].len(), expected.len());
        }
    }
    expected
}

#[test]
fn wherever_particles_are_the_picture_is_the_same() {
    let expected = assert_same_of_shares(&[spheres(5000)], &SIZES);
    assert!(expected[1].counts.blocks_merged > 0);
    // Values, local models, surfaces, and a lattice, which every rank has.
    assert_same_of_shares(&[ellipsoids(3000), ball(1000, 0.5), lattice(12)], &[2, 3]);
}

#[test]
fn planes_of_a_boundary_and_normals_travel() {
    let mut cut = ellipsoids(2000);
    let edges = |x: f32| {
        let mut edges = [[0.0, 0.0, 0.0, f32::INFINITY]; ewa_splat::scene::MOST_EDGES];
        edges[0] = [-1.0, 0.0, 0.0, x];
        edges
    };
    let mut planes = BoundaryPlanes::default();
    let mut normals = Vec::new();
    let Particles::Anisotropic { positions, .. } = &cut.particles else {
        panic!("ellipsoids");
    };
    for (i, p) in positions.iter().enumerate() {
        let distance = 0.8 - p.x as f32;
        let is_cut = distance < 0.2 && distance > -0.1;
        if is_cut {
            planes.edges.push(edges(distance));
        }
        planes
            .of_particle
            .push(if is_cut { planes.edges.len() as u32 } else { 0 });
        normals.push(ewa_splat::math::normal_code(DVec3::new(1.0, i as f64, 0.5)));
    }
    assert!(planes.edges.len() > 50);
    cut.boundary = Some(Boundary::Planes(planes));
    cut.normals = Some(normals);
    assert_same_of_shares(&[cut], &[1, 3]);
}

#[test]
fn without_numbers_ranks_follow_one_another() {
    let whole = spheres(4000);
    let expected = alone(std::slice::from_ref(&whole), &frames());
    let found = each(3, |rank| {
        // The second rank has none.
        let cuts = [0, 1500, 1500, 4000];
        let own: Vec<u32> = (cuts[rank.rank()]..cuts[rank.rank() + 1]).collect();
        let share = vec![taken(&whole, &own)];
        let renderer = Renderer::new(rank, share, &SceneOptions::default()).unwrap();
        drawn(renderer, &frames()).0
    });
    assert!(found[0] == expected);
}

#[test]
fn shares_of_different_scenes_are_refused_by_all() {
    let refused = |share: &(dyn Fn(usize) -> Share + Sync), words: &str| {
        let found = each(3, |rank| {
            let share = share(rank.rank());
            Renderer::new(rank, share, &SceneOptions::default()).map(|_| ())
        });
        for result in found {
            match result {
                Err(error @ (Error::Invalid { .. } | Error::OfRank { .. })) => {
                    assert!(error.to_string().contains(words), "{error}");
                }
                other => panic!("{other:?}"),
            }
        }
    };
    refused(
        &|rank| Share::from(vec![if rank == 1 { ellipsoids(9) } else { spheres(9) }]),
        "others on rank 1 than on rank 0",
    );
    refused(
        &|rank| Share::from(vec![spheres(9); 1 + rank / 2]),
        "others on rank 2 than on rank 0",
    );
    let twice = |_| Share {
        volumes: vec![spheres(2)],
        numbers: Some(vec![vec![4, 5]]),
        planes: None,
    };
    refused(&twice, "two of number 4");
    let few = |rank| Share {
        volumes: vec![spheres(2)],
        numbers: Some(vec![vec![2 * rank as u64; 2 - rank / 2]]),
        planes: None,
    };
    refused(&few, "a number for each particle");
}
