//! One reservoir update, for one trajectory or for several side by side, in one written summation order.
//!
//! The recurrent weights are stored in blocks of eight rows by one column: a dense matrix has every column in
//! every group of eight rows, a sparse one only some. Eight rows advance together as the lanes of a vector
//! register, and each row still adds its terms from left to right: first the drive, then column after column.
//! A batch of trajectories is the same sum with a second set of lanes, so it gives the same bits.

use crate::tanh::tanh;

/// Rows in a block: two AVX registers or four SSE2 ones.
pub(crate) const LANES: usize = 8;

/// A borrowed block matrix: group `g` owns blocks `starts[g] .. starts[g + 1]`, each one column of eight values.
#[derive(Clone, Copy)]
pub(crate) struct Blocks<'a> {
    pub(crate) starts: &'a [u32],
    pub(crate) columns: &'a [u32],
    pub(crate) values: &'a [[f64; LANES]],
}

impl<'a> Blocks<'a> {
    #[inline(always)]
    fn group(self, g: usize) -> (&'a [u32], &'a [[f64; LANES]]) {
        let range = self.starts[g] as usize..self.starts[g + 1] as usize;
        (&self.columns[range.clone()], &self.values[range])
    }
}

/// `x ← (1 − a)·x + a·tanh(drive + W x)` for one trajectory, in place; `scratch` is as long as `x`.
///
/// Both lengths are a multiple of eight. The instruction set is chosen at run time; the bits do not depend on it,
/// because nothing here may be contracted into a fused product.
pub(crate) fn update(w: Blocks<'_>, leak: f64, drive: &[f64], x: &mut [f64], scratch: &mut [f64]) {
    pulp::Arch::new().dispatch(|| update_plain(w, leak, drive, x, scratch));
}

#[inline(always)]
fn update_plain(w: Blocks<'_>, leak: f64, drive: &[f64], x: &mut [f64], scratch: &mut [f64]) {
    let (sums, _) = scratch.as_chunks_mut::<LANES>();
    let (drive, _) = drive.as_chunks::<LANES>();
    for (g, (sum, start)) in sums.iter_mut().zip(drive).enumerate() {
        let (columns, values) = w.group(g);
        let mut total = *start;
        for (column, value) in columns.iter().zip(values) {
            let input = x[*column as usize];
            for lane in 0..LANES {
                total[lane] += value[lane] * input;
            }
        }
        *sum = total;
    }
    leak_towards(leak, x, scratch);
}

/// The same update for `B` trajectories: unit `i` of trajectory `b` is `x[i][b]`. Same bits as [`update`] on each.
pub(crate) fn update_batch<const B: usize>(
    w: Blocks<'_>,
    leak: f64,
    drive: &[[f64; B]],
    x: &mut [[f64; B]],
    scratch: &mut [[f64; B]],
) {
    pulp::Arch::new().dispatch(|| {
        for g in 0..drive.len() / LANES {
            half_group::<B, 0>(w, g, drive, x, scratch);
            half_group::<B, 4>(w, g, drive, x, scratch);
        }
        leak_towards(leak, x.as_flattened_mut(), scratch.as_flattened());
    });
}

/// Four rows of a group at a time: `4 · B` running sums are what the registers hold.
#[inline(always)]
fn half_group<const B: usize, const FIRST: usize>(
    w: Blocks<'_>,
    g: usize,
    drive: &[[f64; B]],
    x: &[[f64; B]],
    scratch: &mut [[f64; B]],
) {
    let (columns, values) = w.group(g);
    let row = g * LANES + FIRST;
    let mut totals = [drive[row], drive[row + 1], drive[row + 2], drive[row + 3]];
    for (column, value) in columns.iter().zip(values) {
        let inputs = x[*column as usize];
        for r in 0..4 {
            for b in 0..B {
                totals[r][b] += value[FIRST + r] * inputs[b];
            }
        }
    }
    scratch[row..row + 4].copy_from_slice(&totals);
}

#[inline(always)]
fn leak_towards(leak: f64, x: &mut [f64], sums: &[f64]) {
    let keep = 1.0 - leak;
    for (x, sum) in x.iter_mut().zip(sums) {
        *x = keep * *x + leak * tanh(*sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reservoir::Reservoir;
    use crate::seeded::Shape;

    fn reservoir() -> Reservoir {
        let shape = Shape {
            units: 61,
            inputs: 2,
            ..Shape::default()
        };
        Reservoir::from_seed(&shape, 3).expect("the shape is legal")
    }

    fn run<F: FnMut(&[f64], &mut [f64], &mut [f64])>(reservoir: &Reservoir, input: [f64; 2], mut step: F) -> Vec<f64> {
        let mut drive = vec![0.0; reservoir.padded_units()];
        reservoir.drive(&input, &mut drive);
        let (mut x, mut scratch) = (vec![0.0; drive.len()], vec![0.0; drive.len()]);
        for _ in 0..50 {
            step(&drive, &mut x, &mut scratch);
        }
        x
    }

    #[test]
    fn the_dispatched_and_the_plain_update_agree_bit_for_bit() {
        let reservoir = reservoir();
        let (w, leak) = (reservoir.blocks(), reservoir.leak());
        let dispatched = run(&reservoir, [0.3, -0.7], |d, x, s| update(w, leak, d, x, s));
        let plain = run(&reservoir, [0.3, -0.7], |d, x, s| update_plain(w, leak, d, x, s));
        assert!(dispatched.iter().any(|x| x.abs() > 1e-3), "the reservoir never moved");
        assert_eq!(bits(&dispatched), bits(&plain));
    }

    #[test]
    fn a_batch_gives_the_bits_of_each_trajectory_alone() {
        let reservoir = reservoir();
        let inputs = [[0.3, -0.7], [1.0, 0.0], [-1.0, 0.5], [0.0, 0.0]];
        let alone = inputs.map(|input| run(&reservoir, input, |d, x, s| update(reservoir.blocks(), 0.3, d, x, s)));
        let mut drive = vec![[0.0; 4]; reservoir.padded_units()];
        for (b, input) in inputs.iter().enumerate() {
            let mut one = vec![0.0; drive.len()];
            reservoir.drive(input, &mut one);
            for (row, value) in drive.iter_mut().zip(one) {
                row[b] = value;
            }
        }
        let (mut x, mut scratch) = (vec![[0.0; 4]; drive.len()], vec![[0.0; 4]; drive.len()]);
        for _ in 0..50 {
            update_batch(reservoir.blocks(), 0.3, &drive, &mut x, &mut scratch);
        }
        for (b, alone) in alone.iter().enumerate() {
            let batched: Vec<f64> = x.iter().map(|row| row[b]).collect();
            assert_eq!(bits(&batched), bits(alone));
        }
    }

    fn bits(x: &[f64]) -> Vec<u64> {
        x.iter().map(|x| x.to_bits()).collect()
    }
}
