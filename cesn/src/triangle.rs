//! The triangular factor of the interval, and `|L⁻¹ z|²` for one state or for eight at a time.
//!
//! `L` is kept in panels of eight rows, each panel column by column, so that eight rows are the lanes when one
//! state is solved for, and eight states are the lanes when many are. In both, row `i` computes
//! `v_i = (z_i − L_i0 v_0 − L_i1 v_1 − …) · (1 / L_ii)`, left to right, and the square sum runs from first to
//! last: one state and many give the same bits.

use crate::update::LANES;

type Lanes = [f64; LANES];

/// A lower triangular matrix with a positive diagonal, ready for forward substitution.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Triangle {
    size: usize,
    /// Strictly lower part: panel `q` has `8 (q + 1)` columns and begins at column `4 q (q + 1)` of this list.
    panels: Vec<Lanes>,
    inverse_diagonal: Vec<Lanes>,
}

impl Triangle {
    /// Builds the panels from `element(row, column)`, `column ≤ row < size`. Rows added for padding are unit rows.
    pub(crate) fn new(size: usize, element: impl Fn(usize, usize) -> f64) -> Self {
        let groups = size.div_ceil(LANES);
        let mut panels = Vec::with_capacity(4 * groups * (groups + 1));
        let mut inverse_diagonal = vec![[1.0; LANES]; groups];
        for (q, inverse) in inverse_diagonal.iter_mut().enumerate() {
            for column in 0..LANES * (q + 1) {
                panels.push(std::array::from_fn(|lane| match LANES * q + lane {
                    row if row < size && column < row => element(row, column),
                    _ => 0.0,
                }));
            }
            for row in LANES * q..size.min(LANES * (q + 1)) {
                inverse[row - LANES * q] = 1.0 / element(row, row);
            }
        }
        Self {
            size,
            panels,
            inverse_diagonal,
        }
    }

    pub(crate) fn size(&self) -> usize {
        self.size
    }

    /// Rows after padding.
    pub(crate) fn padded(&self) -> usize {
        self.inverse_diagonal.len() * LANES
    }

    /// `|L⁻¹ z|²`, leaving `L⁻¹ z` in `z`, whose length is [`Self::padded`] with zeros past the end.
    ///
    /// Costs `p² / 2` products.
    pub(crate) fn squared_norm(&self, z: &mut [f64]) -> f64 {
        pulp::Arch::new().dispatch(|| self.squared_norm_plain(z))
    }

    #[inline(always)]
    fn squared_norm_plain(&self, z: &mut [f64]) -> f64 {
        let (z, _) = z.as_chunks_mut::<LANES>();
        let mut total = 0.0;
        for q in 0..self.inverse_diagonal.len() {
            let mut solved = z[q];
            let diagonal = self.corner(q, q);
            for j in 0..LANES {
                solved[j] *= self.inverse_diagonal[q][j];
                let v = solved[j];
                for lane in j + 1..LANES {
                    solved[lane] -= diagonal[j][lane] * v;
                }
                total += v * v;
            }
            z[q] = solved;
            self.subtract_from_rows_below(q, &solved, z);
        }
        total
    }

    #[inline(always)]
    fn subtract_from_rows_below(&self, q: usize, solved: &Lanes, z: &mut [Lanes]) {
        for (i, rest) in z.iter_mut().enumerate().skip(q + 1) {
            let mut total = *rest;
            for (weights, v) in self.corner(i, q).iter().zip(solved) {
                for lane in 0..LANES {
                    total[lane] -= weights[lane] * v;
                }
            }
            *rest = total;
        }
    }

    /// Eight columns of panel `i`: rows `8 i ..`, columns `8 q ..`.
    #[inline(always)]
    fn corner(&self, i: usize, q: usize) -> &[Lanes] {
        let first = 4 * i * (i + 1) + LANES * q;
        &self.panels[first..first + LANES]
    }

    /// `|L⁻¹ z|²` of eight states, `z[i][s]` being element `i` of state `s`; leaves the solutions in `z`.
    pub(crate) fn squared_norms(&self, z: &mut [Lanes]) -> Lanes {
        pulp::Arch::new().dispatch(|| self.squared_norms_plain(z))
    }

    #[inline(always)]
    fn squared_norms_plain(&self, z: &mut [Lanes]) -> Lanes {
        let mut totals = [0.0; LANES];
        for q in 0..self.inverse_diagonal.len() {
            let (solved, rest) = z.split_at_mut(LANES * q);
            let rows = &mut rest[..LANES];
            let first = 4 * q * (q + 1);
            let panel = &self.panels[first..first + LANES * q];
            subtract_products::<0>(panel, solved, rows);
            subtract_products::<4>(panel, solved, rows);
            self.solve_corner(q, rows, &mut totals);
        }
        totals
    }

    #[inline(always)]
    fn solve_corner(&self, q: usize, rows: &mut [Lanes], totals: &mut Lanes) {
        let corner = self.corner(q, q);
        for j in 0..LANES {
            let mut v = rows[j];
            for s in 0..LANES {
                v[s] *= self.inverse_diagonal[q][j];
                totals[s] += v[s] * v[s];
            }
            rows[j] = v;
            for r in j + 1..LANES {
                for s in 0..LANES {
                    rows[r][s] -= corner[j][r] * v[s];
                }
            }
        }
    }
}

/// Four rows at a time: their 32 running sums and two loads fill the sixteen AVX registers.
#[inline(always)]
fn subtract_products<const FIRST: usize>(panel: &[Lanes], solved: &[Lanes], rows: &mut [Lanes]) {
    let mut totals = [rows[FIRST], rows[FIRST + 1], rows[FIRST + 2], rows[FIRST + 3]];
    for (weights, v) in panel.iter().zip(solved) {
        for r in 0..4 {
            for s in 0..LANES {
                totals[r][s] -= weights[FIRST + r] * v[s];
            }
        }
    }
    rows[FIRST..FIRST + 4].copy_from_slice(&totals);
}

/// What a model file keeps: the rows, each up to its diagonal.
#[derive(bincode::Encode, bincode::Decode)]
pub(crate) struct StoredTriangle {
    size: u32,
    rows: Vec<f64>,
}

impl From<&Triangle> for StoredTriangle {
    fn from(triangle: &Triangle) -> Self {
        let mut rows = Vec::with_capacity(triangle.size * (triangle.size + 1) / 2);
        for row in 0..triangle.size {
            let (q, lane) = (row / LANES, row % LANES);
            let panel = &triangle.panels[4 * q * (q + 1)..];
            rows.extend(panel[..row].iter().map(|column| column[lane]));
            rows.push(triangle.inverse_diagonal[q][lane]);
        }
        Self {
            size: u32::try_from(triangle.size).unwrap_or(u32::MAX),
            rows,
        }
    }
}

impl TryFrom<StoredTriangle> for Triangle {
    type Error = &'static str;

    fn try_from(stored: StoredTriangle) -> Result<Self, &'static str> {
        let size = stored.size as usize;
        if size > crate::reservoir::MAX_UNITS + 1 || stored.rows.len() != size * (size + 1) / 2 {
            return Err("the triangular factor has the wrong number of elements");
        }
        if stored.rows.iter().any(|x| !x.is_finite()) {
            return Err("the triangular factor holds a number that is not finite");
        }
        let at = |row: usize, column: usize| stored.rows[row * (row + 1) / 2 + column];
        let mut triangle = Self::new(size, at);
        for row in 0..size {
            triangle.inverse_diagonal[row / LANES][row % LANES] = at(row, row);
        }
        Ok(triangle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{generator, signed_unit};

    fn triangle(size: usize) -> Triangle {
        let mut rng = generator(5, "triangle");
        let elements: Vec<f64> = (0..size * size).map(|_| signed_unit(&mut rng)).collect();
        Triangle::new(size, |i, j| {
            if i == j {
                2.0 + elements[i * size + j]
            } else {
                0.1 * elements[i * size + j]
            }
        })
    }

    fn states(triangle: &Triangle) -> Vec<Vec<f64>> {
        let mut rng = generator(6, "states");
        let mut state = || {
            let mut z: Vec<f64> = (0..triangle.size()).map(|_| signed_unit(&mut rng)).collect();
            z.resize(triangle.padded(), 0.0);
            z
        };
        (0..LANES).map(|_| state()).collect()
    }

    #[test]
    fn one_state_and_eight_give_the_same_bits_dispatched_or_plain() {
        for size in [1, 7, 8, 9, 21, 61] {
            let triangle = triangle(size);
            let states = states(&triangle);
            let mut tile: Vec<Lanes> = (0..triangle.padded())
                .map(|i| std::array::from_fn(|s| states[s][i]))
                .collect();
            let mut plain_tile = tile.clone();
            let many = triangle.squared_norms(&mut tile);
            assert_eq!(
                many.map(f64::to_bits),
                triangle.squared_norms_plain(&mut plain_tile).map(f64::to_bits)
            );
            for (state, many) in states.iter().zip(many) {
                let one = triangle.squared_norm(&mut state.clone());
                let plain = triangle.squared_norm_plain(&mut state.clone());
                assert_eq!(one.to_bits(), many.to_bits());
                assert_eq!(one.to_bits(), plain.to_bits());
            }
        }
    }

    #[test]
    fn a_stored_triangle_comes_back_bit_for_bit() {
        let triangle = triangle(21);
        assert_eq!(Triangle::try_from(StoredTriangle::from(&triangle)), Ok(triangle));
    }

    #[test]
    fn the_solution_satisfies_the_equation() {
        let triangle = Triangle::new(2, |i, j| [[2.0, 0.0], [1.0, 4.0]][i][j]);
        let mut z = vec![2.0, 9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert!((triangle.squared_norm(&mut z) - 5.0).abs() < 1e-15);
    }
}
