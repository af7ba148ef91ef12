//! A small writer of inline SVG: shapes by class, so that the page's style sheet colours them, and axes.

use std::fmt::Write as _;

/// Text that is safe between tags and in attributes.
pub(super) fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            other => safe.push(other),
        }
    }
    safe
}

/// From values to pixels, along one axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Scale {
    /// Values from `low` to `high` lie between the pixels `from` and `to`. A range without length gets one.
    pub(super) fn new((low, high): (f64, f64), (from, to): (f64, f64)) -> Self {
        let (low, high) = if low.is_finite() && high.is_finite() {
            (low, high)
        } else {
            (0.0, 1.0)
        };
        let high = if high - low > 1e-12 { high } else { low + 1.0 };
        Self { low, high, from, to }
    }

    pub(super) fn at(&self, value: f64) -> f64 {
        self.from + (value - self.low) / (self.high - self.low) * (self.to - self.from)
    }

    /// The pixel at which the scale begins.
    pub(super) const fn start(&self) -> f64 {
        self.from
    }

    /// Round values within the range, about `count` of them, and the decimals that tell them apart.
    pub(super) fn ticks(&self, count: f64) -> (Vec<f64>, usize) {
        let rough = (self.high - self.low) / count.max(1.0);
        let magnitude = libm::pow(10.0, libm::floor(libm::log10(rough)));
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|factor| factor * magnitude)
            .into_iter()
            .find(|step| *step >= rough * 0.999);
        let step = step.unwrap_or(rough);
        let mut ticks = Vec::new();
        let mut value = (self.low / step).ceil() * step;
        while value <= self.high + step * 1e-6 && ticks.len() < 50 {
            ticks.push(if value.abs() < step * 1e-6 { 0.0 } else { value });
            value += step;
        }
        let decimals = (0..6)
            .find(|decimals| step * libm::pow(10.0, f64::from(*decimals)) >= 0.999)
            .unwrap_or(6);
        (ticks, usize::try_from(decimals).unwrap_or(0))
    }
}

/// The smallest range that holds all values.
pub(super) fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values
        .filter(|value| value.is_finite())
        .fold(None, |range, value| match range {
            None => Some((value, value)),
            Some((low, high)) => Some((low.min(value), high.max(value))),
        })
}

/// A picture that is being drawn.
#[derive(Debug)]
pub(super) struct Svg {
    body: String,
    width: f64,
    height: f64,
    described: String,
}

impl Svg {
    /// An empty picture; `described` is what those hear who cannot see it.
    pub(super) fn new(width: f64, height: f64, described: &str) -> Self {
        Self {
            body: String::new(),
            width,
            height,
            described: escaped(described),
        }
    }

    pub(super) fn line(&mut self, class: &str, (x1, y1): (f64, f64), (x2, y2): (f64, f64)) {
        self.put(format_args!(
            "<line class=\"{class}\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>"
        ));
    }

    /// Many short lines as one path.
    pub(super) fn lines(&mut self, class: &str, lines: impl Iterator<Item = [(f64, f64); 2]>) {
        let mut path = String::new();
        for [(x1, y1), (x2, y2)] in lines {
            let _ = write!(path, "M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}");
        }
        if !path.is_empty() {
            self.put(format_args!("<path class=\"{class}\" d=\"{path}\"/>"));
        }
    }

    pub(super) fn polyline(&mut self, class: &str, points: impl Iterator<Item = (f64, f64)>) {
        let points = listed(points);
        if !points.is_empty() {
            self.put(format_args!("<polyline class=\"{class}\" points=\"{points}\"/>"));
        }
    }

    pub(super) fn polygon(&mut self, class: &str, points: impl Iterator<Item = (f64, f64)>) {
        let points = listed(points);
        if !points.is_empty() {
            self.put(format_args!("<polygon class=\"{class}\" points=\"{points}\"/>"));
        }
    }

    /// A disc with a text that appears under the pointer; none if it is empty.
    pub(super) fn disc(&mut self, class: &str, (x, y): (f64, f64), radius: f64, says: &str) {
        let disc = format!("<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\"");
        if says.is_empty() {
            self.put(format_args!("{disc}/>"));
        } else {
            let says = escaped(says);
            self.put(format_args!("{disc}><title>{says}</title></circle>"));
        }
    }

    pub(super) fn text(&mut self, class: &str, (x, y): (f64, f64), text: &str) {
        let text = escaped(text);
        self.put(format_args!(
            "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{text}</text>"
        ));
    }

    /// Text from bottom to top, centred at a point.
    pub(super) fn text_upwards(&mut self, (x, y): (f64, f64), text: &str) {
        let text = escaped(text);
        self.put(format_args!(
            "<text class=\"mid\" transform=\"translate({x:.1} {y:.1}) rotate(-90)\">{text}</text>"
        ));
    }

    /// Horizontal grid lines with their values to the left.
    pub(super) fn grid_y(&mut self, scale: &Scale, (left, right): (f64, f64), count: f64) {
        let (ticks, decimals) = scale.ticks(count);
        for tick in ticks {
            let y = scale.at(tick);
            self.line("grid", (left, y), (right, y));
            self.text("end", (left - 5.0, y + 4.0), &format!("{tick:.decimals$}"));
        }
    }

    /// Vertical grid lines with their values below.
    pub(super) fn grid_x(&mut self, scale: &Scale, (top, bottom): (f64, f64), count: f64) {
        let (ticks, decimals) = scale.ticks(count);
        for tick in ticks {
            let x = scale.at(tick);
            self.line("grid", (x, top), (x, bottom));
            self.text("mid", (x, bottom + 14.0), &format!("{tick:.decimals$}"));
        }
    }

    /// The picture as an element of a page.
    pub(super) fn finish(self) -> String {
        let Self {
            body,
            width,
            height,
            described,
        } = self;
        format!(
            "<svg viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" \
             aria-label=\"{described}\">{body}</svg>\n"
        )
    }

    fn put(&mut self, arguments: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = self.body.write_fmt(arguments);
    }
}

fn listed(points: impl Iterator<Item = (f64, f64)>) -> String {
    let mut list = String::new();
    for (x, y) in points {
        let _ = write!(list, "{x:.1},{y:.1} ");
    }
    list
}
