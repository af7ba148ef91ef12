//! Obstacles, start, goal, workspace.

use rerun::components::FillMode;
use tandem_wire::{Scene, Vec3};

use super::{Sheet, colours, plan, single, xyz};

pub(super) fn draw(scene: &Scene, sheet: &mut Sheet<'_>) {
    draw_obstacles(scene, sheet);
    draw_workspace(scene, sheet);
    draw_place("goal", scene.goal, single(scene.goal_tolerance.0), colours::GOAL, sheet);
    draw_place("start", scene.start, 0.005, colours::START, sheet);
}

fn draw_obstacles(scene: &Scene, sheet: &mut Sheet<'_>) {
    let obstacles = &scene.obstacles;
    let middle = |foot: Vec3, height: f64| xyz(foot + Vec3::new(0.0, 0.0, height / 2.0));
    let solids = rerun::Cylinders3D::from_lengths_and_radii(
        obstacles.iter().map(|obstacle| single(obstacle.height.0)),
        obstacles.iter().map(|obstacle| single(obstacle.radius.0)),
    )
    .with_centers(
        obstacles
            .iter()
            .map(|obstacle| middle(obstacle.foot, obstacle.height.0)),
    )
    .with_colors([colours::OBSTACLE])
    .with_fill_mode(FillMode::Solid);
    sheet.draw("world/obstacles", &solids);
    let discs = rerun::Points2D::new(obstacles.iter().map(|obstacle| plan(obstacle.foot)))
        .with_radii(obstacles.iter().map(|obstacle| single(obstacle.radius.0)))
        .with_colors([colours::OBSTACLE])
        .with_draw_order(10.0);
    sheet.draw("plan/obstacles", &discs);
}

fn draw_workspace(scene: &Scene, sheet: &mut Sheet<'_>) {
    let (low, high) = (scene.workspace.min, scene.workspace.max);
    let walls = rerun::Boxes3D::from_mins_and_sizes([xyz(low)], [xyz(high - low)])
        .with_colors([colours::WORKSPACE])
        .with_fill_mode(FillMode::MajorWireframe);
    sheet.draw("world/workspace", &walls);
    let border = rerun::Boxes2D::from_mins_and_sizes([plan(low)], [plan(high - low)])
        .with_colors([colours::WORKSPACE])
        .with_draw_order(1.0);
    sheet.draw("plan/workspace", &border);
}

fn draw_place(name: &str, place: Vec3, radius: f32, colour: rerun::Color, sheet: &mut Sheet<'_>) {
    let ball = rerun::Points3D::new([xyz(place)])
        .with_radii([radius])
        .with_colors([colour]);
    sheet.draw(
        &format!("world/{name}"),
        &ball.with_labels([name]).with_show_labels(true),
    );
    let disc = rerun::Points2D::new([plan(place)])
        .with_radii([radius])
        .with_colors([colour]);
    let disc = disc.with_labels([name]).with_show_labels(true).with_draw_order(5.0);
    sheet.draw(&format!("plan/{name}"), &disc);
}
