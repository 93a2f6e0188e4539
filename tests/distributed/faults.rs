//! Tests that all ranks learn of an error on one.

use ewa_splat::distributed::{Collective, Renderer, ThreadRank};
use ewa_splat::view::Camera;
use ewa_splat::{Error, SceneOptions, Settings, Task};
use glam::DVec3;

use crate::ranks::each;
use crate::scenes::spheres;

fn camera() -> Camera {
    Camera::perspective(DVec3::NEG_Z * 4.0, DVec3::ZERO, DVec3::Y, 40.0, [64, 48])
}

fn renderer(rank: ThreadRank) -> ewa_splat::Result<Renderer> {
    Renderer::of_whole(rank, vec![spheres(3000)], &SceneOptions::default())
}

#[test]
fn a_frame_that_one_rank_cancels_is_no_ones_and_the_next_is_drawn() {
    let found = each(3, |rank| {
        let is_second = rank.rank() == 1;
        let mut renderer = renderer(rank).unwrap();
        let task = Task::new();
        task.cancel();
        let cancelled = Settings {
            task: is_second.then_some(task),
            ..Settings::default()
        };
        let first = renderer.render(&camera(), &cancelled).map(|_| ());
        let next = renderer.render(&camera(), &Settings::default());
        (first, next.map(|image| image.is_some()))
    });
    for (rank, (cancelled, next)) in found.iter().enumerate() {
        match cancelled {
            Err(Error::Cancelled) => assert_eq!(rank, 1),
            Err(error @ Error::OfRank { rank: 1, .. }) => {
                assert_eq!(error.to_string(), "rank 1: cancelled");
            }
            other => panic!("{other:?}"),
        }
        assert_eq!(*next.as_ref().unwrap(), rank == 0);
    }
}

#[test]
fn a_rank_that_is_gone_is_named() {
    for (gone, when) in [(0, 0), (2, 0), (1, 1), (2, 1)] {
        let found = each(3, |rank| {
            let is_gone = rank.rank() == gone;
            if is_gone && when == 0 {
                return Ok(());
            }
            let mut renderer = renderer(rank)?;
            if is_gone {
                return Ok(());
            }
            renderer.render(&camera(), &Settings::default()).map(|_| ())
        });
        for (rank, result) in found.iter().enumerate() {
            match result {
                Ok(()) => assert_eq!(rank, gone),
                Err(Error::OfRank { rank, .. }) => assert_eq!(*rank, gone),
                Err(other) => panic!("{other}"),
            }
        }
    }
}

#[test]
fn a_scene_that_one_rank_cannot_make_is_refused_by_all() {
    let found = each(3, |rank| {
        let mut scene = spheres(100);
        if rank.rank() == 2 {
            scene.values = Some(ewa_splat::scene::Values::U8(vec![1; 5]));
        }
        Renderer::of_whole(rank, vec![scene], &SceneOptions::default()).map(|_| ())
    });
    let texts: Vec<String> = found
        .into_iter()
        .map(|r| r.unwrap_err().to_string())
        .collect();
    assert!(texts[2].starts_with("point volume: values: expected"));
    assert_eq!(texts[0], format!("rank 2: {}", texts[2]));
    assert_eq!(texts[1], texts[0]);
}
