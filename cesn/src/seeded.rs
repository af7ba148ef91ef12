//! A reservoir from a seed: block-sparse uniform weights, scaled to a spectral radius.
//!
//! `W` is uniform in (−1, 1) and scaled to the wanted spectral radius; the bias column of `W_in` is uniform in ± its
//! gain, and each input column uniform in ± its own gain.

use faer::{Mat, Par};
use rand_chacha::ChaCha8Rng;

use crate::random::{below, generator, signed_unit};
use crate::reservoir::{Reservoir, ReservoirError, check_range, check_sizes};
use crate::update::LANES;

/// What a seeded reservoir shall look like. All gains are unitless; inputs are normalised before they arrive.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// `N`, the number of units.
    pub units: usize,
    /// `K`, the number of inputs, bias not counted.
    pub inputs: usize,
    /// Share of recurrent weights that are not zero, in (0, 1]; 1 is dense.
    ///
    /// The zeros come in blocks: eight neighbouring units share their inputs, with weights of their own. The
    /// vector unit then needs no gather. It costs nothing: on the planar task, ten seeds each, the error inside the
    /// demonstrations is 2.1 ± 0.9 mm with blocks, 2.0 ± 0.9 mm with scattered zeros and 2.1 ± 1.0 mm dense, and the
    /// error outside 4.3, 4.3 and 4.5 mm.
    pub density: f64,
    /// Modulus of the largest eigenvalue of `W`.
    pub spectral_radius: f64,
    /// Half the width of the bias column.
    pub bias_gain: f64,
    /// Half the width of each input column; one gain for all inputs, or one for each.
    pub input_gains: Vec<f64>,
    /// `a`, in (0, 1].
    pub leak: f64,
}

impl Default for Shape {
    fn default() -> Self {
        Self {
            units: 500,
            inputs: 1,
            density: 0.1,
            spectral_radius: 1.4,
            bias_gain: 0.5,
            input_gains: vec![0.003],
            leak: 0.3,
        }
    }
}

impl Reservoir {
    /// Draws the weights of `shape` from `seed`. Same seed, same weights, on every machine.
    ///
    /// The spectral radius comes from all eigenvalues of the unscaled matrix (10 N³ or so operations: by far the
    /// dearest step of making a model) and is rounded to 32 bits before it divides, so that
    /// differences in the last bits between processors do not reach the weights.
    ///
    /// # Errors
    /// When a number of `shape` lies outside its range, or the matrix has no eigenvalue to scale.
    pub fn from_seed(shape: &Shape, seed: u64) -> Result<Self, ReservoirError> {
        check_shape(shape)?;
        let mut rng = generator(seed, "weights");
        let mut reservoir = Self::empty(shape.units, shape.inputs, shape.leak);
        reservoir.draw_recurrent(shape.density, &mut rng);
        reservoir.scale_to(shape.spectral_radius)?;
        reservoir.draw_inputs(shape, &mut rng);
        Ok(reservoir)
    }

    /// The largest eigenvalue modulus of `W`, from all eigenvalues of the dense matrix.
    ///
    /// # Errors
    /// When the eigenvalue iteration does not converge.
    pub fn spectral_radius(&self) -> Result<f64, ReservoirError> {
        use faer::linalg::evd::{ComputeEigenvectors, evd_real, evd_scratch};
        let n = self.units;
        let mut real = faer::diag::Diag::<f64>::zeros(n);
        let mut imaginary = faer::diag::Diag::<f64>::zeros(n);
        let no = ComputeEigenvectors::No;
        let scratch = evd_scratch::<f64>(n, no, no, Par::Seq, Default::default());
        let mut memory = faer::dyn_stack::MemBuffer::new(scratch);
        evd_real(
            self.dense().as_ref(),
            real.as_mut(),
            imaginary.as_mut(),
            None,
            None,
            Par::Seq,
            faer::dyn_stack::MemStack::new(&mut memory),
            Default::default(),
        )
        .map_err(|_no_detail| ReservoirError::Eigenvalues)?;
        let modulus = |i: usize| libm::hypot(real[i], imaginary[i]);
        Ok((0..n).map(modulus).fold(0.0, f64::max))
    }

    fn dense(&self) -> Mat<f64> {
        let mut dense = Mat::zeros(self.units, self.units);
        for g in 0..self.groups() {
            for block in self.starts[g] as usize..self.starts[g + 1] as usize {
                for lane in 0..LANES.min(self.units - g * LANES) {
                    dense[(g * LANES + lane, self.columns[block] as usize)] = self.values[block][lane];
                }
            }
        }
        dense
    }

    fn draw_recurrent(&mut self, density: f64, rng: &mut ChaCha8Rng) {
        let mut deck: Vec<usize> = (0..self.units).collect();
        let share = density * self.units as f64;
        let taken = (1..self.units).find(|n| *n as f64 >= share - 0.5).unwrap_or(self.units);
        for g in 0..self.groups() {
            for i in 0..taken {
                let other = i + below(rng, self.units - i);
                deck.swap(i, other);
            }
            deck[..taken].sort_unstable();
            for &column in &deck[..taken] {
                let live = LANES.min(self.units - g * LANES);
                let mut values = [0.0; LANES];
                values[..live].fill_with(|| signed_unit(rng));
                self.push_block(column, values);
            }
            self.end_group();
        }
    }

    fn scale_to(&mut self, wanted: f64) -> Result<(), ReservoirError> {
        let radius = self.spectral_radius()?;
        if radius < 1e-6 {
            return Err(ReservoirError::Nilpotent);
        }
        let factor = wanted / ((radius * ROUNDING).round() / ROUNDING);
        for value in self.values.as_flattened_mut() {
            *value *= factor;
        }
        Ok(())
    }

    fn draw_inputs(&mut self, shape: &Shape, rng: &mut ChaCha8Rng) {
        let (units, padded) = (self.units, self.padded_units());
        for (column, weights) in self.w_in.chunks_exact_mut(padded).enumerate() {
            let gain = match column {
                0 => shape.bias_gain,
                _ => shape.input_gains[(column - 1).min(shape.input_gains.len() - 1)],
            };
            weights[..units].fill_with(|| gain * signed_unit(rng));
        }
    }
}

/// `2^28`: spectral radii before scaling are of order ten, so this keeps about 32 bits.
const ROUNDING: f64 = 268_435_456.0;

fn check_shape(shape: &Shape) -> Result<(), ReservoirError> {
    check_sizes(shape.units, shape.inputs)?;
    let unit = |x: f64| x > 0.0 && x <= 1.0;
    check_range(
        "the density",
        shape.density,
        unit(shape.density),
        "above 0 and at most 1",
    )?;
    check_range("the leak rate", shape.leak, unit(shape.leak), "above 0 and at most 1")?;
    let radius = shape.spectral_radius;
    check_range(
        "the spectral radius",
        radius,
        radius > 0.0 && radius <= 10.0,
        "above 0 and at most 10",
    )?;
    let gain = |x: f64| (0.0..=10.0).contains(&x);
    check_range("the bias gain", shape.bias_gain, gain(shape.bias_gain), "0 to 10")?;
    for &value in &shape.input_gains {
        check_range("an input gain", value, gain(value), "0 to 10")?;
    }
    match shape.input_gains.len() {
        found if found == 1 || found == shape.inputs => Ok(()),
        found => Err(ReservoirError::Gains {
            found,
            inputs: shape.inputs,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_weights_and_another_seed_others() {
        let shape = Shape {
            units: 40,
            ..Shape::default()
        };
        let one = Reservoir::from_seed(&shape, 1).expect("legal");
        assert_eq!(one, Reservoir::from_seed(&shape, 1).expect("legal"));
        assert_ne!(one, Reservoir::from_seed(&shape, 2).expect("legal"));
    }

    #[test]
    fn the_weights_have_the_density_and_the_spectral_radius_asked_for() {
        for density in [0.1, 0.5, 1.0] {
            let shape = Shape {
                units: 100,
                density,
                ..Shape::default()
            };
            let reservoir = Reservoir::from_seed(&shape, 7).expect("legal");
            assert!((reservoir.spectral_radius().expect("converges") - 1.4).abs() < 1e-8);
            let w = reservoir.dense();
            let nonzero = w.col_iter().flat_map(|c| c.iter()).filter(|x| x.abs() > 0.0).count();
            assert!((nonzero as f64 - density * 100.0 * 100.0).abs() < 0.5);
        }
    }

    #[test]
    fn illegal_shapes_are_refused_with_the_number_that_is_wrong() {
        let with = |change: fn(&mut Shape)| {
            let mut shape = Shape {
                units: 20,
                ..Shape::default()
            };
            change(&mut shape);
            Reservoir::from_seed(&shape, 1).expect_err("illegal").to_string()
        };
        assert_eq!(with(|s| s.units = 0), "0 units: a reservoir has 1 to 4096");
        assert_eq!(
            with(|s| s.leak = 1.5),
            "the leak rate is 1.5; it must be above 0 and at most 1"
        );
        assert_eq!(
            with(|s| s.density = f64::NAN),
            "the density is NaN; it must be above 0 and at most 1"
        );
        assert!(with(|s| s.input_gains = vec![0.1, 0.2]).starts_with("2 input gains for 1 inputs"));
    }
}
