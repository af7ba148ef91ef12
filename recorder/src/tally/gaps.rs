//! Which numbers are missing, as ranges, in bounded memory.

/// Ranges that are remembered. Of a stream with more gaps the newest are, and the others counted.
const RANGES: usize = 64;

/// Missing numbers: half-open ranges, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct Gaps {
    ranges: Vec<(u64, u64)>,
    forgotten: u64,
}

impl Gaps {
    pub(super) fn add(&mut self, from: u64, to: u64) {
        if self.ranges.len() == RANGES {
            self.ranges.remove(0);
            self.forgotten += 1;
        }
        self.ranges.push((from, to));
    }

    /// Takes `from..to` out of the gaps and says how many numbers that were.
    pub(super) fn fill(&mut self, from: u64, to: u64) -> u64 {
        let mut filled = 0;
        let mut left = Vec::with_capacity(self.ranges.len() + 1);
        for &(low, high) in &self.ranges {
            let (cut_low, cut_high) = (low.max(from), high.min(to));
            if cut_low >= cut_high {
                left.push((low, high));
                continue;
            }
            filled += cut_high - cut_low;
            left.extend([(low, cut_low), (cut_high, high)].into_iter().filter(|(a, b)| a < b));
        }
        if left.len() > RANGES {
            left.remove(0);
            self.forgotten += 1;
        }
        self.ranges = left;
        filled
    }

    pub(super) fn ranges(&self) -> impl Iterator<Item = (u64, u64)> + '_ {
        self.ranges.iter().copied()
    }

    pub(super) const fn forgotten(&self) -> u64 {
        self.forgotten
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_filled_in_the_middle_leaves_its_ends() {
        let mut gaps = Gaps::default();
        gaps.add(3, 9);
        assert_eq!(gaps.fill(5, 6), 1);
        assert_eq!(gaps.fill(5, 6), 0, "again");
        assert_eq!(gaps.ranges().collect::<Vec<_>>(), [(3, 5), (6, 9)]);
    }

    #[test]
    fn more_gaps_than_fit_are_counted_and_the_newest_kept() {
        let mut gaps = Gaps::default();
        for start in (0..200).step_by(2) {
            gaps.add(start, start + 1);
        }
        assert_eq!(gaps.ranges().count(), RANGES);
        assert_eq!(gaps.ranges().last(), Some((198, 199)));
        assert_eq!(gaps.forgotten(), 100 - RANGES as u64);
    }
}
