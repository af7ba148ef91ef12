//! From movements to the rows of a regression: run the reservoir along each, side by side, and collect states.

use std::ops::Range;

use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, Par};

use crate::regression::FitError;
use crate::reservoir::Reservoir;
use crate::update::update_batch;

/// One movement to learn from.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// The reservoir's input at every step: `T × K`, row by row, already normalised.
    pub inputs: Vec<f64>,
    /// What the readout shall say: `T × Ny`, row by row.
    pub targets: Vec<f64>,
    /// How much each of its rows counts, above 0.
    pub weight: f64,
    /// Which demonstration it belongs to; a jittered copy belongs to its original's. Never decreasing in a list.
    pub demonstration: usize,
    /// Its first step that is learnt, unless the washout is longer.
    pub from: usize,
}

impl Sequence {
    fn skipped(&self, washout: usize) -> usize {
        self.from.max(washout)
    }
}

/// The weighted rows of the regression, `√w · [1; x]` and `√w · y`, grouped by demonstration.
#[derive(Clone, Debug)]
pub struct Samples {
    /// `p × n`: one column for each sample, so that a state is contiguous.
    pub(crate) design: Mat<f64>,
    /// `n × Ny`.
    pub(crate) targets: Mat<f64>,
    pub(crate) weights: Vec<f64>,
    pub(crate) demonstrations: Vec<Range<usize>>,
}

impl Samples {
    /// Runs `reservoir` from rest along every sequence and keeps the states from step `washout` on.
    ///
    /// Up to eight sequences advance together, each recurrent weight multiplying eight neighbouring numbers; the
    /// states have the bits that [`Reservoir::update`] gives.
    ///
    /// # Errors
    /// When there is nothing to learn from, row lengths do not fit, or a number is not finite.
    pub fn harvest(
        reservoir: &Reservoir,
        sequences: &[Sequence],
        outputs: usize,
        washout: usize,
    ) -> Result<Self, FitError> {
        let lengths = check(reservoir, sequences, outputs)?;
        let kept = sequences.iter().zip(&lengths);
        let kept: Vec<usize> = kept
            .map(|(one, length)| length.saturating_sub(one.skipped(washout)))
            .collect();
        let firsts: Vec<usize> = kept
            .iter()
            .scan(0, |next, kept| Some(replace_add(next, *kept)))
            .collect();
        let n: usize = kept.iter().sum();
        if n == 0 {
            return Err(FitError::NoSamples { washout });
        }
        let mut samples = Self::empty(reservoir.units() + 1, n, outputs);
        for ((sequence, first), kept) in sequences.iter().zip(&firsts).zip(&kept) {
            samples.add_targets(sequence, *first, *kept, washout);
        }
        for (sequences, firsts) in sequences.chunks(8).zip(firsts.chunks(8)) {
            match sequences.len() {
                0..=4 => samples.run::<4>(reservoir, sequences, firsts, washout),
                _ => samples.run::<8>(reservoir, sequences, firsts, washout),
            }
        }
        Ok(samples)
    }

    fn empty(p: usize, n: usize, outputs: usize) -> Self {
        Self {
            design: Mat::zeros(p, n),
            targets: Mat::zeros(n, outputs),
            weights: Vec::with_capacity(n),
            demonstrations: Vec::new(),
        }
    }

    fn add_targets(&mut self, sequence: &Sequence, first: usize, kept: usize, washout: usize) {
        let outputs = self.targets.ncols();
        let root = sequence.weight.sqrt();
        let rows = sequence.targets.chunks_exact(outputs).skip(sequence.skipped(washout));
        for (row, target) in (first..first + kept).zip(rows) {
            for (k, value) in target.iter().enumerate() {
                self.targets[(row, k)] = root * value;
            }
            self.weights.push(sequence.weight);
        }
        self.demonstrations
            .resize(self.demonstrations.len().max(sequence.demonstration + 1), first..first);
        self.demonstrations[sequence.demonstration].end = first + kept;
    }

    fn run<const B: usize>(&mut self, reservoir: &Reservoir, batch: &[Sequence], firsts: &[usize], washout: usize) {
        let (inputs, padded) = (reservoir.inputs(), reservoir.padded_units());
        let (mut x, mut scratch, mut drive) = (vec![[0.0; B]; padded], vec![[0.0; B]; padded], vec![[0.0; B]; padded]);
        let mut one = vec![0.0; padded];
        let length = |sequence: &Sequence| sequence.targets.len() / self.targets.ncols();
        let lengths: Vec<usize> = batch.iter().map(length).collect();
        for t in 0..lengths.iter().copied().max().unwrap_or(0) {
            for (b, sequence) in batch.iter().enumerate().filter(|(b, _)| t < lengths[*b]) {
                let row = |t: usize| &sequence.inputs[t * inputs..(t + 1) * inputs];
                if t == 0 || row(t) != row(t - 1) {
                    reservoir.drive(row(t), &mut one);
                    drive.iter_mut().zip(&one).for_each(|(drive, value)| drive[b] = *value);
                }
            }
            update_batch(reservoir.blocks(), reservoir.leak(), &drive, &mut x, &mut scratch);
            for (b, sequence) in batch
                .iter()
                .enumerate()
                .filter(|(b, one)| (one.skipped(washout)..lengths[*b]).contains(&t))
            {
                let root = sequence.weight.sqrt();
                let column = self.design.col_as_slice_mut(firsts[b] + t - sequence.skipped(washout));
                column[0] = root;
                column[1..].iter_mut().zip(&x).for_each(|(z, x)| *z = root * x[b]);
            }
        }
    }

    /// The number of rows, copies counted in full.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.weights.len()
    }

    /// `n = Σ weights`: what copies of a demonstration cannot enlarge.
    #[must_use]
    pub fn effective_rows(&self) -> f64 {
        self.weights.iter().sum()
    }

    /// `p = N + 1`.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.design.nrows()
    }

    /// `√w · [1; x]` of one sample.
    #[must_use]
    pub fn row(&self, sample: usize) -> Option<&[f64]> {
        (sample < self.rows()).then(|| self.design.col_as_slice(sample))
    }

    /// `ZᵀZ`, weighted, in the lower half of a `p × p` matrix, column by column; the upper half is zero.
    #[must_use]
    pub fn gram(&self) -> Vec<f64> {
        let gram = self.gram_matrix();
        gram.col_iter()
            .flat_map(|column| column.iter().copied().collect::<Vec<_>>())
            .collect()
    }

    pub(crate) fn gram_matrix(&self) -> Mat<f64> {
        let mut gram = Mat::zeros(self.columns(), self.columns());
        let whole = BlockStructure::Rectangular;
        let (z, lower) = (&self.design, BlockStructure::TriangularLower);
        triangular::matmul(
            &mut gram,
            lower,
            Accum::Replace,
            z,
            whole,
            z.transpose(),
            whole,
            1.0,
            Par::Seq,
        );
        gram
    }

    /// The same samples without those of one demonstration (and its copies).
    pub(crate) fn without(&self, demonstration: usize) -> Self {
        let out = &self.demonstrations[demonstration];
        let kept: Vec<usize> = (0..self.rows()).filter(|row| !out.contains(row)).collect();
        Self {
            design: Mat::from_fn(self.columns(), kept.len(), |i, j| self.design[(i, kept[j])]),
            targets: Mat::from_fn(kept.len(), self.targets.ncols(), |i, k| self.targets[(kept[i], k)]),
            weights: kept.iter().map(|row| self.weights[*row]).collect(),
            demonstrations: Vec::new(),
        }
    }
}

fn replace_add(next: &mut usize, step: usize) -> usize {
    let before = *next;
    *next += step;
    before
}

fn check(reservoir: &Reservoir, sequences: &[Sequence], outputs: usize) -> Result<Vec<usize>, FitError> {
    let mut lengths = Vec::with_capacity(sequences.len());
    let mut demonstration = 0;
    for (index, sequence) in sequences.iter().enumerate() {
        let length = sequence.targets.len().checked_div(outputs).unwrap_or(0);
        let fits = length * outputs == sequence.targets.len() && length * reservoir.inputs() == sequence.inputs.len();
        let follows = sequence.demonstration == demonstration || sequence.demonstration == demonstration + 1;
        if length == 0 || !fits || !follows {
            return Err(FitError::Sequence { index });
        }
        let numbers = sequence.inputs.iter().chain(&sequence.targets);
        if !numbers.chain([&sequence.weight]).all(|x| x.is_finite()) || sequence.weight <= 0.0 {
            return Err(FitError::NotFinite { index });
        }
        demonstration = sequence.demonstration;
        lengths.push(length);
    }
    Ok(lengths)
}
