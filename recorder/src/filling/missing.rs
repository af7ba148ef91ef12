//! Which entries of a journal are missing, as ranges, in bounded memory.

/// Ranges that are told apart; the last ones of more are asked for together with what lies between.
const RANGES: usize = 64;

/// Missing indices: half-open ranges, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct Missing {
    ranges: Vec<(u64, u64)>,
}

impl Missing {
    pub(super) fn add(&mut self, from: u64, to: u64) {
        let full = self.ranges.len() >= RANGES;
        match self.ranges.last_mut() {
            Some(last) if full => last.1 = to,
            _ => self.ranges.push((from, to)),
        }
    }

    pub(super) fn remove(&mut self, from: u64, to: u64) {
        let parts = |&(low, high): &(u64, u64)| {
            let left = (low, high.min(from).max(low));
            let right = (low.max(to).min(high), high);
            if to <= low || from >= high {
                [(low, high), (high, high)]
            } else {
                [left, right]
            }
        };
        let left = self.ranges.iter().flat_map(parts).filter(|(low, high)| low < high);
        self.ranges = left.collect();
    }

    /// How many of `from..to` are missing.
    pub(super) fn overlap(&self, from: u64, to: u64) -> u64 {
        let each = |&(low, high): &(u64, u64)| high.min(to).saturating_sub(low.max(from));
        self.ranges.iter().map(each).sum()
    }

    pub(super) fn oldest(&self) -> Option<(u64, u64)> {
        self.ranges.first().copied()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.ranges.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_taken_out_of_the_middle_leaves_its_ends() {
        let mut missing = Missing::default();
        missing.add(3, 9);
        missing.remove(5, 6);
        assert_eq!(missing.ranges, [(3, 5), (6, 9)]);
        assert_eq!(missing.overlap(4, 8), 3);
    }

    #[test]
    fn of_more_ranges_than_fit_the_last_reaches_over_what_lies_between() {
        let mut missing = Missing::default();
        for start in (0..200).step_by(2) {
            missing.add(start, start + 1);
        }
        assert_eq!(missing.ranges.len(), RANGES);
        assert_eq!(missing.ranges.last(), Some(&(126, 199)));
    }
}
