//! The keys of a plan.

use tandem_link::config::PaceName;
use tandem_operator::SourceKind;
use tandem_settings::{choices, settings};

settings! {
    /// What the experiment is called, who drives, and how often.
    pub struct PlanSettings("plan") {
        /// What it is called.
        pub name: String = "";
        /// Who drives: "simulated" humans in lockstep, or a person at the "keyboard" in real time.
        pub source: SourceKind = SourceKind::Simulated;
        /// What drives a simulated human's time: "max", the messages, in lockstep; or "real", the clock, under which
        /// messages stream at their own rate. Persons drive in real time.
        pub pace: PaceName = PaceName::Max;
        /// The participants' codes. Simulated humans drive one after the other. Of persons, only those listed may take
        /// part; if none is listed, anybody may.
        pub participants: Vec<String> = [];
        /// How often every condition meets every context.
        pub repetitions: u32 = 1, in 1..=1000;
        /// Practice trials before a participant's first one; they count in no result.
        pub practice: u32 = 0, in 0..=100;
        /// What every random number is made from: orders, wishes and tremors. The same human meets every condition.
        pub seed: u64 = 1;
        /// A trial that has not ended by itself ends after this many seconds.
        pub time_limit_s: u32 = 15, in 1..=3600;
        /// How often a trial that was aborted is offered again before the run goes on without it.
        pub offers: u32 = 3, in 1..=20;
    }
}

choices! {
    /// What stays together.
    pub enum Blocks {
        /// All contexts of a condition, then the next condition.
        Conditions = "conditions",
        /// All conditions of a context, then the next context.
        Contexts = "contexts",
    }
}

choices! {
    /// In which order conditions come.
    pub enum Conditions {
        /// As the plan writes them.
        Fixed = "fixed",
        /// Drawn anew for every block and participant.
        Random = "random",
        /// By a Latin square in which every condition also follows every other equally often (Williams 1949); the
        /// participant's place in the list of codes, or else the number at the code's end, picks the row.
        LatinSquare = "latin-square",
    }
}

choices! {
    /// In which order contexts come.
    pub enum Contexts {
        /// As the plan writes them.
        Fixed = "fixed",
        /// Drawn anew for every block and participant.
        Random = "random",
    }
}

settings! {
    /// In which order a participant meets conditions and contexts.
    pub struct OrderSettings("order") {
        /// What stays together.
        pub blocks: Blocks = Blocks::Conditions;
        /// The order of the conditions.
        pub conditions: Conditions = Conditions::Fixed;
        /// The order of the contexts.
        pub contexts: Contexts = Contexts::Fixed;
    }
}

settings! {
    /// How long a person rests; simulated humans do not.
    pub struct PauseSettings("pauses") {
        /// At least so many seconds between two trials.
        pub between_s: u32 = 0, in 0..=3600;
        /// After so many trials a longer pause; 0 for none.
        pub long_every: u32 = 0, in 0..=1000;
        /// How many seconds that takes.
        pub long_s: u32 = 60, in 0..=3600;
    }
}

settings! {
    /// A trial is a success if the tool came to rest within robot-sim.goal_tolerance_m of the goal and this holds, too.
    pub struct SuccessSettings("success") {
        /// Nothing was touched.
        pub no_contact: bool = false;
        /// The robot never stopped on the way.
        pub no_stop: bool = false;
    }
}

settings! {
    /// One way of driving; beside these keys any section of tandem.toml, as in conditions.fixed.arbiter.law.
    pub struct ConditionSettings("conditions.NAME") {
        /// What tables and figures call it; its name if empty.
        pub label: String = "";
        /// The models, one for each checkpoint, by their names in [models]; without, the one trained on the shipped
        /// demonstrations.
        pub models: Vec<String> = [];
    }
}

choices! {
    /// How a context lies to the demonstrations.
    pub enum Group {
        /// It is one of them.
        Demonstrated = "demonstrated",
        /// Between them.
        Interpolated = "interpolated",
        /// Beyond them.
        Extrapolated = "extrapolated",
    }
}

settings! {
    /// One wish; beside these keys any section of tandem.toml, as in contexts.a165.operator.human.departure_mm.
    pub struct ContextSettings("contexts.NAME") {
        /// Amplitude of the path that the human wishes to follow, in metres.
        pub amplitude_m: f64 = 0.12, in -0.3..=0.3;
        /// How it lies to the demonstrations.
        pub group: Group = Group::Interpolated;
        /// What a person is told before the trial; its name if empty.
        pub label: String = "";
    }
}

settings! {
    /// A model that conditions name: a file, or demonstrations that it is trained on before the first trial.
    pub struct ModelSettings("models.NAME") {
        /// The model file, relative to the plan.
        pub file: String = "";
        /// Demonstrations to train on (CSV), relative to the plan.
        pub demonstrations: Vec<String> = [];
        /// The step at which its checkpoint lies; its context is where the demonstrations are then.
        pub checkpoint_step: usize = 41, in 1..=100_000;
        /// Whether it is conditioned anew on every tick after its checkpoint, from where the tool is then.
        pub replan: bool = false;
        /// The seed of its weights and its jitter.
        pub seed: u64 = 1;
    }
}
