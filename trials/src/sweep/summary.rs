//! What came of a sweep: means for every group, and paired comparisons that say who beats whom.
//!
//! A *group* is one human, departure, region (contexts inside or outside of the demonstrations) and law. Trials of one
//! seed share a person, so the seed is the sample: a figure is the mean of the seeds' means, with its standard error
//! over seeds. A comparison is paired, seed by seed and context by context, and counts as a difference only beyond
//! two standard errors of the mean difference.

use serde::Serialize;
use tandem_settings::Choice;

use crate::sweep::cell::{CellResult, Run};
use crate::sweep::grid::Grid;

/// Which contexts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Region {
    /// Between the demonstrations.
    Inside,
    /// Outside of them.
    Outside,
}

/// A mean over seeds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Figure {
    /// The mean of the seeds' means.
    pub mean: f64,
    /// Its standard error over seeds; absent for one seed.
    pub error: Option<f64>,
}

/// The figures of one human, departure, region and law.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Group {
    /// The human's name.
    pub human: String,
    /// In millimetres.
    pub departure_mm: f64,
    /// Which contexts.
    pub region: Region,
    /// The law, as given.
    pub law: String,
    /// How many trials.
    pub trials: usize,
    /// The share that came to rest at the goal.
    pub reached: f64,
    /// The share that touched an obstacle.
    pub touched: f64,
    /// The human's effort after the checkpoint, in metres per second.
    pub effort_m_s: Option<Figure>,
    /// The tool's distance from the human's own wish after the checkpoint, in metres.
    pub wish_error_m: Option<Figure>,
    /// The tool's distance from the forecast, in metres.
    pub forecast_error_m: Option<Figure>,
    /// The smallest distance to an obstacle, mean over trials, in metres.
    pub clearance_m: Option<Figure>,
    /// The human's weight after the checkpoint.
    pub weight: Option<Figure>,
    /// How long a trial took, in seconds.
    pub duration_s: Option<Figure>,
}

/// How one law did against another in one group: better, the same, or worse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Beyond two standard errors, in the right direction.
    Better,
    /// Within two standard errors.
    Same,
    /// Beyond two standard errors, in the wrong direction.
    Worse,
}

/// What is compared: effort, distance from the wish, clearance. All that issue from one trial, in this order.
pub(crate) const MEASURES: [(&str, Read, Sense); 3] = [
    ("effort", |run| run.effort_m_s, Sense::Low),
    ("wish", |run| run.wish_error_m, Sense::Low),
    ("clearance", |run| run.clearance_m, Sense::High),
];

pub(crate) type Read = fn(&Run) -> Option<f64>;

/// Which way is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sense {
    Low,
    High,
}

/// One law against one other over all groups: in how many groups it was better, the same, worse, for each measure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Contest {
    /// The law.
    pub law: String,
    /// The other one.
    pub against: String,
    /// Groups in which its effort was better, the same, worse.
    pub effort: [usize; 3],
    /// The same for the distance from the wish.
    pub wish: [usize; 3],
    /// The same for clearance.
    pub clearance: [usize; 3],
    /// Groups in which it was worse in nothing and better in something.
    pub dominates: usize,
    /// Groups in which it was better in nothing and worse in something.
    pub dominated: usize,
}

/// What the first adaptive law did for one human, departure and region.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ruling {
    /// The human's name.
    pub human: String,
    /// In millimetres.
    pub departure_mm: f64,
    /// Which contexts.
    pub region: Region,
    /// Effort against the human alone, as a share of it: −0.2 is a fifth less.
    pub against_human: Option<f64>,
    /// Effort against half and half, the paper's baseline.
    pub against_fixed: Option<f64>,
    /// The constant with the least effort, and the adaptive law's effort against it.
    pub best_constant: Option<(String, f64)>,
    /// `helps`, `constant better` or `hurts`; in words, with what it rests on.
    pub word: &'static str,
}

/// Everything.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Trials in all.
    pub trials: usize,
    /// Cells that are missing because the sweep was cut short.
    pub missing_cells: usize,
    /// Every group, in the order of the grid.
    pub groups: Vec<Group>,
    /// Every law that is no plain constant against every other law.
    pub contests: Vec<Contest>,
    /// What the adaptive law did where.
    pub rulings: Vec<Ruling>,
}

/// The runs of one group, for each law and seed.
struct Pile<'a> {
    human: usize,
    departure: usize,
    region: Region,
    /// By law, then by seed.
    laws: Vec<Vec<Option<Vec<&'a Run>>>>,
}

impl Summary {
    /// Sums up what is there.
    #[must_use]
    pub fn of(grid: &Grid, results: &[CellResult]) -> Self {
        let piles = piles(grid, results);
        Self {
            trials: results.iter().map(|result| result.runs.len()).sum(),
            missing_cells: grid.cells().count() - results.len(),
            groups: piles.iter().flat_map(|pile| groups(grid, pile)).collect(),
            contests: contests(grid, &piles),
            rulings: piles.iter().filter_map(|pile| ruling(grid, pile)).collect(),
        }
    }
}

fn piles<'a>(grid: &Grid, results: &'a [CellResult]) -> Vec<Pile<'a>> {
    let settings = &grid.settings;
    let seeds = usize::try_from(settings.seeds).unwrap_or(usize::MAX);
    let mut piles = Vec::new();
    for human in 0..settings.humans.len() {
        for departure in 0..settings.departures_mm.len() {
            for region in [Region::Inside, Region::Outside] {
                let laws = vec![vec![None; seeds]; grid.laws.len()];
                piles.push(Pile {
                    human,
                    departure,
                    region,
                    laws,
                });
            }
        }
    }
    let per_human = settings.departures_mm.len() * 2;
    for result in results {
        let first = result.cell.human * per_human + result.cell.departure * 2;
        for pile in piles.iter_mut().skip(first).take(2) {
            let inside = pile.region == Region::Inside;
            let runs: Vec<&Run> = result.runs.iter().filter(|run| run.inside == inside).collect();
            let seed = usize::try_from(result.cell.seed).unwrap_or(usize::MAX);
            if let Some(slot) = pile.laws.get_mut(result.cell.law).and_then(|law| law.get_mut(seed))
                && !runs.is_empty()
            {
                *slot = Some(runs);
            }
        }
    }
    piles.retain(|pile| pile.laws.iter().flatten().any(Option::is_some));
    piles
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

impl Figure {
    /// The mean of one number for each seed.
    fn of(seeds: &[f64]) -> Option<Self> {
        let middle = mean(seeds.iter().copied())?;
        let count = seeds.len() as f64;
        let square: f64 = seeds.iter().map(|value| (value - middle) * (value - middle)).sum();
        let error = (seeds.len() > 1).then(|| (square / (count - 1.0) / count).sqrt());
        Some(Self { mean: middle, error })
    }
}

impl Pile<'_> {
    fn runs(&self, law: usize) -> impl Iterator<Item = &Run> {
        self.laws[law].iter().flatten().flatten().copied()
    }

    fn figure(&self, law: usize, read: Read) -> Option<Figure> {
        let seeds = self.laws[law].iter().flatten();
        let means: Vec<f64> = seeds
            .filter_map(|runs| mean(runs.iter().filter_map(|run| read(run))))
            .collect();
        Figure::of(&means)
    }

    /// `law − other`, paired by seed and context.
    fn difference(&self, law: usize, other: usize, read: Read) -> Option<Figure> {
        let seeds = self.laws[law].iter().zip(&self.laws[other]);
        let both = seeds.filter_map(|(ours, theirs)| ours.as_ref().zip(theirs.as_ref()));
        let differences: Vec<f64> = both
            .filter_map(|(ours, theirs)| {
                let pairs = ours.iter().zip(theirs);
                mean(pairs.filter_map(|(ours, theirs)| Some(read(ours)? - read(theirs)?)))
            })
            .collect();
        Figure::of(&differences)
    }

    fn verdict(&self, law: usize, other: usize, read: Read, sense: Sense) -> Verdict {
        let Some(Figure {
            mean,
            error: Some(error),
        }) = self.difference(law, other, read)
        else {
            return Verdict::Same;
        };
        match (mean.abs() > 2.0 * error, (mean < 0.0) == (sense == Sense::Low)) {
            (false, _) => Verdict::Same,
            (true, true) => Verdict::Better,
            (true, false) => Verdict::Worse,
        }
    }
}

fn groups<'a>(grid: &'a Grid, pile: &'a Pile<'_>) -> impl Iterator<Item = Group> + 'a {
    (0..grid.laws.len()).map(move |law| {
        let trials = pile.runs(law).count();
        let share = |of: fn(&Run) -> bool| pile.runs(law).filter(|run| of(run)).count() as f64 / trials.max(1) as f64;
        Group {
            human: grid.settings.humans[pile.human].name().to_owned(),
            departure_mm: grid.settings.departures_mm[pile.departure],
            region: pile.region,
            law: grid.laws[law].name.clone(),
            trials,
            reached: share(|run| run.reached_goal),
            touched: share(|run| run.contacts > 0),
            effort_m_s: pile.figure(law, |run| run.effort_m_s),
            wish_error_m: pile.figure(law, |run| run.wish_error_m),
            forecast_error_m: pile.figure(law, |run| run.forecast_error_m),
            clearance_m: pile.figure(law, |run| run.clearance_m),
            weight: pile.figure(law, |run| run.weight),
            duration_s: pile.figure(law, |run| run.duration_s),
        }
    })
}

fn contests(grid: &Grid, piles: &[Pile<'_>]) -> Vec<Contest> {
    let laws = 0..grid.laws.len();
    let challengers = laws.clone().filter(|law| grid.laws[*law].constant.is_none());
    let pairs = challengers.flat_map(|law| {
        laws.clone()
            .filter(move |other| *other != law)
            .map(move |other| (law, other))
    });
    pairs.map(|(law, other)| contest(grid, piles, law, other)).collect()
}

fn contest(grid: &Grid, piles: &[Pile<'_>], law: usize, other: usize) -> Contest {
    let mut counts = [[0; 3]; 3];
    let (mut dominates, mut dominated) = (0, 0);
    for pile in piles {
        let verdicts = MEASURES.map(|(_, read, sense)| pile.verdict(law, other, read, sense));
        for (count, verdict) in counts.iter_mut().zip(verdicts) {
            count[verdict as usize] += 1;
        }
        let (better, worse) = (verdicts.contains(&Verdict::Better), verdicts.contains(&Verdict::Worse));
        dominates += usize::from(better && !worse);
        dominated += usize::from(worse && !better);
    }
    let [effort, wish, clearance] = counts;
    Contest {
        law: grid.laws[law].name.clone(),
        against: grid.laws[other].name.clone(),
        effort,
        wish,
        clearance,
        dominates,
        dominated,
    }
}

/// What the paper's law did in one place; nothing if the grid has none.
fn ruling(grid: &Grid, pile: &Pile<'_>) -> Option<Ruling> {
    let effort: Read = |run| run.effort_m_s;
    let law = grid.laws.iter().position(|law| law.name == "adaptive")?;
    let share = |other: usize| {
        let (difference, base) = (pile.difference(law, other, effort)?, pile.figure(other, effort)?);
        Some(difference.mean / base.mean)
    };
    let constant = |weight: f64| grid.laws.iter().position(|law| law.constant == Some(weight));
    let lesser = |a: &usize, b: &usize| {
        let of = |law: usize| pile.figure(law, effort).map_or(f64::INFINITY, |figure| figure.mean);
        of(*a).total_cmp(&of(*b))
    };
    // Half and half is the paper's baseline, and nobody asks the human alone to save the human's effort.
    let shared = (0..grid.laws.len()).filter(|other| grid.laws[*other].constant.is_some_and(|weight| weight < 1.0));
    let best = shared.min_by(lesser);
    let against = |other: Option<usize>| other.map(|other| pile.verdict(law, other, effort, Sense::Low));
    let word = match (against(constant(1.0)), against(best)) {
        (Some(Verdict::Worse), _) => "hurts",
        (_, Some(Verdict::Worse)) => "constant better",
        (Some(Verdict::Better), _) => "helps",
        _ => "no difference",
    };
    Some(Ruling {
        human: grid.settings.humans[pile.human].name().to_owned(),
        departure_mm: grid.settings.departures_mm[pile.departure],
        region: pile.region,
        against_human: constant(1.0).and_then(share),
        against_fixed: constant(0.5).and_then(share),
        best_constant: best.and_then(|best| Some((grid.laws[best].name.clone(), share(best)?))),
        word,
    })
}
