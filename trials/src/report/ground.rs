//! The table seen from above, as the figures draw it.

use super::case::{Curves, Dot};
use super::svg::{Scale, Svg, range};

/// A point of the table seen from above, for drawing.
pub(super) struct Ground {
    x: Scale,
    y: Scale,
    /// Pixels per metre.
    zoom: f64,
}

impl Ground {
    /// As large as fits, with equal scales: everything between the corners, seen from above.
    pub(super) fn new(corners: ((f64, f64), (f64, f64)), at: (f64, f64), size: (f64, f64)) -> Self {
        let ((x0, x1), (y0, y1)) = corners;
        let zoom = (size.0 / (x1 - x0).max(1e-3)).min(size.1 / (y1 - y0).max(1e-3));
        let (wide, high) = (zoom * (x1 - x0), zoom * (y1 - y0));
        let (left, top) = (at.0 + (size.0 - wide) / 2.0, at.1 + (size.1 - high) / 2.0);
        Self {
            x: Scale::new((x0, x1), (left, left + wide)),
            y: Scale::new((y0, y1), (top, top + high)),
            zoom,
        }
    }

    pub(super) fn at(&self, [x, y]: Dot) -> (f64, f64) {
        (self.x.at(f64::from(x)), self.y.at(f64::from(y)))
    }

    pub(super) fn curve<'a>(&'a self, dots: &'a [Dot]) -> impl Iterator<Item = (f64, f64)> + 'a {
        dots.iter().map(|dot| self.at(*dot))
    }

    /// Obstacles and goal.
    pub(super) fn scenery(&self, svg: &mut Svg, curves: &Curves) {
        for (centre, radius) in &curves.obstacles {
            svg.disc("obstacle", self.at(*centre), self.zoom * f64::from(*radius), "obstacle");
        }
        if let Some((goal, tolerance)) = curves.goal {
            svg.disc(
                "goal",
                self.at(goal),
                (self.zoom * f64::from(tolerance)).max(4.0),
                "goal and its tolerance",
            );
        }
    }

    /// A bar of ten centimetres.
    pub(super) fn ruler(&self, svg: &mut Svg, (x, y): (f64, f64)) {
        svg.line("ruler", (x, y), (x + 0.1 * self.zoom, y));
        svg.text("", (x + 0.1 * self.zoom + 5.0, y + 4.0), "10 cm");
    }
}

/// The smallest rectangle around what the tools of these trials did, their goals and obstacles.
pub(super) fn corners<'a>(curves: impl Iterator<Item = &'a Curves> + Clone) -> ((f64, f64), (f64, f64)) {
    let along = |axis: usize| {
        let values = curves.clone().flat_map(move |curves| {
            let tools = curves
                .tool
                .iter()
                .chain(&curves.wish)
                .map(move |dot| f64::from(dot[axis]));
            let goal = curves.goal.iter().map(move |(goal, _)| f64::from(goal[axis]));
            let obstacles = curves.obstacles.iter().flat_map(move |(centre, radius)| {
                [-1.0, 1.0].map(|side| f64::from(centre[axis]) + side * f64::from(*radius))
            });
            tools.chain(goal).chain(obstacles)
        });
        let (low, high) = range(values).unwrap_or((0.0, 1.0));
        (low - 0.015, high + 0.015)
    };
    (along(0), along(1))
}
