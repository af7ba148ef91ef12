//! The colours, and what they mean.

use rerun::Color;

pub(super) const HUMAN: Color = opaque(244, 143, 46);
pub(super) const ROBOT: Color = opaque(66, 150, 250);
pub(super) const SHARED: Color = opaque(178, 120, 235);
pub(super) const HELD: Color = opaque(130, 130, 138);
pub(super) const RESULT: Color = opaque(235, 235, 240);
pub(super) const OBSTACLE: Color = opaque(214, 74, 66);
/// The way to the nearest obstacle: paler than the obstacle it ends at.
pub(super) const NEAREST: Color = opaque(255, 150, 140);
pub(super) const GOAL: Color = opaque(72, 190, 110);
pub(super) const START: Color = opaque(170, 170, 178);
pub(super) const WORKSPACE: Color = opaque(84, 88, 100);
pub(super) const LINK: Color = opaque(196, 200, 208);
pub(super) const TOOL: Color = opaque(250, 220, 90);
/// Words that nobody's colour fits: the grey of what is held cannot be read on the grey behind a label.
pub(super) const WORD: Color = opaque(240, 240, 244);
/// Behind everything: dark, and of no colour that means something.
pub(super) const BACKGROUND: Color = opaque(16, 17, 22);
/// The forecast's line: the robot's colour, paler than the path that is drawn over it.
pub(super) const FORECAST: Color = opaque(140, 210, 255);
pub(super) const INTERVAL: Color = Color(rerun::datatypes::Rgba32::from_unmultiplied_rgba(66, 150, 250, 70));

/// Of two runs in one picture: as it was, and as it would have been.
pub(super) const ORIGINAL: Color = opaque(206, 206, 198);
pub(super) const ALTERNATIVE: Color = opaque(240, 92, 190);

const fn opaque(r: u8, g: u8, b: u8) -> Color {
    Color(rerun::datatypes::Rgba32::from_unmultiplied_rgba(r, g, b, 255))
}

/// Between the robot's colour at weight 0 and the human's at weight 1.
pub(super) fn of_weight(weight: f64) -> Color {
    let weight = weight.clamp(0.0, 1.0);
    let [robot, shared, human] = [ROBOT, SHARED, HUMAN].map(|colour| colour.to_array());
    let (from, to, part) = if weight < 0.5 {
        (robot, shared, 2.0 * weight)
    } else {
        (shared, human, 2.0 * weight - 1.0)
    };
    let mix = |i: usize| blend(from[i], to[i], part);
    Color::from_rgb(mix(0), mix(1), mix(2))
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "between two bytes lies a byte"
)]
fn blend(from: u8, to: u8, part: f64) -> u8 {
    (f64::from(from) + part * (f64::from(to) - f64::from(from))).round() as u8
}
