//! The reservoir: fixed weights, the state they move, and what a model file keeps of them.
//!
//! `x̃ = tanh(W_in [1; u] + W x)`, `x ← (1 − a) x + a x̃`, with `N` units, `K` inputs and the leak rate `a`.
//! Nothing here is trained.

use crate::update::{Blocks, LANES, update};

/// The largest reservoir: its triangular factor then takes 67 MB, which still fits the model file's limit.
pub const MAX_UNITS: usize = 4096;
/// The most inputs (context and fed-back outputs together).
pub const MAX_INPUTS: usize = 256;

/// Why there is no such reservoir.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReservoirError {
    /// The number of units is zero or above the limit.
    #[error("{units} units: a reservoir has 1 to {MAX_UNITS}")]
    Units {
        /// What was asked for.
        units: usize,
    },
    /// Too many inputs.
    #[error("{inputs} inputs: a reservoir has at most {MAX_INPUTS}")]
    Inputs {
        /// What was asked for.
        inputs: usize,
    },
    /// One of the numbers lies outside its range.
    #[error("{name} is {value}; it must be {allowed}")]
    OutOfRange {
        /// Which number.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The legal range, in words.
        allowed: &'static str,
    },
    /// The number of gains is neither one nor the number of inputs.
    #[error("{found} input gains for {inputs} inputs: give one for all, or one for each")]
    Gains {
        /// How many gains were given.
        found: usize,
        /// How many inputs there are.
        inputs: usize,
    },
    /// A weight matrix has the wrong number of elements.
    #[error("{name} has {found} elements; {expected} are needed")]
    Shape {
        /// Which matrix.
        name: &'static str,
        /// Elements given.
        found: usize,
        /// Elements needed.
        expected: usize,
    },
    /// A weight is NaN or infinite.
    #[error("{name} holds a number that is not finite")]
    NotFinite {
        /// Which matrix.
        name: &'static str,
    },
    /// The random matrix has no eigenvalue to scale (a handful of very sparse units).
    #[error("the random weights have no eigenvalue but zero; use more units or a higher density")]
    Nilpotent,
    /// The eigenvalue iteration did not converge.
    #[error("the eigenvalues of the random weights were not found; try another seed")]
    Eigenvalues,
}

/// Fixed weights and the leak rate; see the [module page](self) for the equations.
#[derive(Clone, Debug, PartialEq)]
pub struct Reservoir {
    pub(crate) units: usize,
    pub(crate) inputs: usize,
    pub(crate) leak: f64,
    pub(crate) starts: Vec<u32>,
    pub(crate) columns: Vec<u32>,
    pub(crate) values: Vec<[f64; LANES]>,
    /// `K + 1` columns, the bias first, each padded to whole groups.
    pub(crate) w_in: Vec<f64>,
}

impl Reservoir {
    /// Takes weights as they are: `w` is `N × N` and `w_in` is `N × (K + 1)`, bias first, both row by row.
    ///
    /// # Errors
    /// When the element counts do not fit, a number is not finite, or the leak rate is outside (0, 1].
    pub fn from_dense(units: usize, inputs: usize, w: &[f64], w_in: &[f64], leak: f64) -> Result<Self, ReservoirError> {
        check_sizes(units, inputs)?;
        check_range(
            "the leak rate",
            leak,
            leak > 0.0 && leak <= 1.0,
            "above 0 and at most 1",
        )?;
        check_matrix("W", w, units * units)?;
        check_matrix("W_in", w_in, units * (inputs + 1))?;
        let mut reservoir = Self::empty(units, inputs, leak);
        for g in 0..reservoir.groups() {
            for column in 0..units {
                let row = |lane: usize| g * LANES + lane;
                let at = |lane: usize| {
                    if row(lane) < units {
                        w[row(lane) * units + column]
                    } else {
                        0.0
                    }
                };
                reservoir.push_block(column, std::array::from_fn(at));
            }
            reservoir.end_group();
        }
        for column in 0..=inputs {
            for row in 0..units {
                let padded = reservoir.padded_units();
                reservoir.w_in[column * padded + row] = w_in[row * (inputs + 1) + column];
            }
        }
        Ok(reservoir)
    }

    /// `N`, the number of units.
    #[must_use]
    pub fn units(&self) -> usize {
        self.units
    }

    /// `K`, the number of inputs, bias not counted.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// `a`, the leak rate.
    #[must_use]
    pub fn leak(&self) -> f64 {
        self.leak
    }

    /// The state every movement starts from, `x(0) = 0`.
    #[must_use]
    pub fn rest(&self) -> State {
        let zeros = vec![0.0; self.padded_units()];
        State {
            units: self.units,
            x: zeros.clone(),
            drive: zeros.clone(),
            scratch: zeros,
        }
    }

    /// Advances `state` by one step under `input` (`K` values; missing ones count as zero, extra ones are ignored).
    ///
    /// `x ← (1 − a) x + a tanh(W_in [1; u] + W x)`. Costs `nnz(W) + N (K + 1)` products and no allocation. Each
    /// row adds bias, inputs and recurrent terms from left to right, so every machine gets the same bits.
    /// A state of a reservoir of another size is put to rest first.
    pub fn update(&self, state: &mut State, input: &[f64]) {
        if state.units != self.units {
            *state = self.rest();
        }
        self.drive(input, &mut state.drive);
        self.update_driven(state);
    }

    /// Advances by one step under the input last set with [`Self::hold`]: what a constant context needs.
    pub(crate) fn update_driven(&self, state: &mut State) {
        update(self.blocks(), self.leak, &state.drive, &mut state.x, &mut state.scratch);
    }

    /// Sets the input that [`Self::update_driven`] applies.
    pub(crate) fn hold(&self, state: &mut State, input: &[f64]) {
        self.drive(input, &mut state.drive);
    }

    /// `W_in [1; u]`, padded; left to right.
    pub(crate) fn drive(&self, input: &[f64], drive: &mut [f64]) {
        let (bias, columns) = self.w_in.split_at(self.padded_units());
        drive.copy_from_slice(bias);
        for (column, value) in columns.chunks_exact(self.padded_units()).zip(input) {
            for (sum, weight) in drive.iter_mut().zip(column) {
                *sum += weight * value;
            }
        }
    }

    pub(crate) fn blocks(&self) -> Blocks<'_> {
        Blocks {
            starts: &self.starts,
            columns: &self.columns,
            values: &self.values,
        }
    }

    pub(crate) fn padded_units(&self) -> usize {
        self.units.next_multiple_of(LANES)
    }

    pub(crate) fn empty(units: usize, inputs: usize, leak: f64) -> Self {
        let w_in = vec![0.0; units.next_multiple_of(LANES) * (inputs + 1)];
        Self {
            units,
            inputs,
            leak,
            starts: vec![0],
            columns: Vec::new(),
            values: Vec::new(),
            w_in,
        }
    }

    pub(crate) fn groups(&self) -> usize {
        self.units.div_ceil(LANES)
    }

    pub(crate) fn push_block(&mut self, column: usize, values: [f64; LANES]) {
        self.columns.push(index(column));
        self.values.push(values);
    }

    pub(crate) fn end_group(&mut self) {
        self.starts.push(index(self.columns.len()));
    }
}

/// Counts here are bounded by `MAX_UNITS²`, far below `u32::MAX`.
fn index(i: usize) -> u32 {
    u32::try_from(i).unwrap_or(u32::MAX)
}

pub(crate) fn check_sizes(units: usize, inputs: usize) -> Result<(), ReservoirError> {
    if units == 0 || units > MAX_UNITS {
        return Err(ReservoirError::Units { units });
    }
    if inputs > MAX_INPUTS {
        return Err(ReservoirError::Inputs { inputs });
    }
    Ok(())
}

pub(crate) fn check_range(
    name: &'static str,
    value: f64,
    legal: bool,
    allowed: &'static str,
) -> Result<(), ReservoirError> {
    if legal {
        Ok(())
    } else {
        Err(ReservoirError::OutOfRange { name, value, allowed })
    }
}

fn check_matrix(name: &'static str, values: &[f64], expected: usize) -> Result<(), ReservoirError> {
    if values.len() != expected {
        return Err(ReservoirError::Shape {
            name,
            found: values.len(),
            expected,
        });
    }
    if values.iter().any(|x| !x.is_finite()) {
        return Err(ReservoirError::NotFinite { name });
    }
    Ok(())
}

/// `x(t)` of one trajectory, with the room an update needs.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    units: usize,
    pub(crate) x: Vec<f64>,
    drive: Vec<f64>,
    scratch: Vec<f64>,
}

impl State {
    /// The activation of every unit, each in [−1, 1].
    #[must_use]
    pub fn activations(&self) -> &[f64] {
        &self.x[..self.units]
    }

    /// Back to `x(0) = 0`.
    pub fn rest(&mut self) {
        self.x.fill(0.0);
    }
}

/// What a model file keeps of a reservoir.
#[derive(bincode::Encode, bincode::Decode)]
pub(crate) struct StoredReservoir {
    units: u32,
    inputs: u32,
    leak: f64,
    starts: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<[f64; LANES]>,
    w_in: Vec<f64>,
}

impl From<&Reservoir> for StoredReservoir {
    fn from(reservoir: &Reservoir) -> Self {
        Self {
            units: index(reservoir.units),
            inputs: index(reservoir.inputs),
            leak: reservoir.leak,
            starts: reservoir.starts.clone(),
            columns: reservoir.columns.clone(),
            values: reservoir.values.clone(),
            w_in: reservoir.w_in.clone(),
        }
    }
}

impl TryFrom<StoredReservoir> for Reservoir {
    type Error = ReservoirError;

    /// Checks everything the update relies on, so that a stored reservoir can never index out of bounds.
    fn try_from(stored: StoredReservoir) -> Result<Self, ReservoirError> {
        let (units, inputs) = (stored.units as usize, stored.inputs as usize);
        check_sizes(units, inputs)?;
        let leak = stored.leak;
        check_range(
            "the leak rate",
            leak,
            leak > 0.0 && leak <= 1.0,
            "above 0 and at most 1",
        )?;
        let starts = &stored.starts;
        let (groups, blocks) = (units.div_ceil(LANES), stored.columns.len());
        check_count("the row groups of W", starts.len(), groups + 1)?;
        check_count("the blocks of W", stored.values.len(), blocks)?;
        let ordered = starts.first() == Some(&0) && starts.is_sorted();
        check_count(
            "the last row group of W",
            starts.last().map_or(0, |s| *s as usize),
            blocks,
        )?;
        if !ordered || stored.columns.iter().any(|c| *c as usize >= units) {
            return Err(ReservoirError::Shape {
                name: "the columns of W",
                found: 0,
                expected: units,
            });
        }
        check_matrix("W", stored.values.as_flattened(), blocks * LANES)?;
        check_matrix("W_in", &stored.w_in, units.next_multiple_of(LANES) * (inputs + 1))?;
        let (starts, columns, values, w_in) = (stored.starts, stored.columns, stored.values, stored.w_in);
        Ok(Self {
            units,
            inputs,
            leak,
            starts,
            columns,
            values,
            w_in,
        })
    }
}

fn check_count(name: &'static str, found: usize, expected: usize) -> Result<(), ReservoirError> {
    if found == expected {
        Ok(())
    } else {
        Err(ReservoirError::Shape { name, found, expected })
    }
}
