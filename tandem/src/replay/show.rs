//! The player in its shell: clock, keys, session file, target.

use std::io;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, never, select};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use tandem_link::Clock;
use tandem_operator::keyboard::RawTerminal;
use tandem_recorder::{Place, Recorded, Reel};
use tandem_wire::{Nanos, Stamp, Topic, seconds};

use super::keyboard::{self, Key, Keyboard, Playing};
use super::player::{Event, Output, Player, Speed};
use super::report::Report;
use super::target::Target;
use crate::session::Part;

/// How often the progress bar moves.
const REFRESH: Duration = Duration::from_millis(100);
/// Of so many messages it is kept how late they were: a loop may go on for days.
const LATE_KEPT: usize = 1 << 22;

/// What plays.
pub(super) struct Show<'a> {
    messages: &'a [&'a Recorded<Place>],
    reel: Reel<Part>,
    /// What is played next, by its index: fetched while there is time, for a chunk takes a millisecond to unpack.
    ready: Option<(usize, Recorded)>,
    player: Player,
    target: Target,
    clock: Clock,
    keyboard: Option<Keyboard<Key>>,
    interrupted: Receiver<()>,
    bar: ProgressBar,
    outputs: Vec<Output>,
    late: Vec<Nanos>,
    passes: u64,
    played: u64,
    /// When the target was last looked at.
    looked: Instant,
}

impl<'a> Show<'a> {
    pub(super) fn new(
        messages: &'a [&'a Recorded<Place>],
        reel: Reel<Part>,
        player: Player,
        target: Target,
        is_live: bool,
        interrupted: Receiver<()>,
    ) -> Self {
        let bar = ProgressBar::with_draw_target(Some(player.end() / 1_000_000), ProgressDrawTarget::stderr());
        let style = ProgressStyle::with_template("{bar:40} {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        // Without a terminal it plays all the same.
        let terminal = is_live.then(|| RawTerminal::open(io::stderr()).ok()).flatten();
        let keyboard = terminal.map(|terminal| Keyboard::listen(terminal, Playing));
        if keyboard.is_some() {
            eprintln!("{}\r", keyboard::HELP);
        }
        Self {
            messages,
            reel,
            ready: None,
            player,
            target,
            clock: Clock::of_process(),
            keyboard,
            interrupted,
            bar,
            outputs: Vec::new(),
            late: Vec::new(),
            passes: 1,
            played: 0,
            looked: Instant::now(),
        }
    }

    /// Plays until the end, or until somebody wants no more of it.
    pub(super) fn run(&mut self) -> anyhow::Result<()> {
        self.show_what_holds(self.player.next())?;
        self.player.begin(self.clock.now());
        loop {
            let Some(event) = self.next_event()? else { return Ok(()) };
            self.player.step(self.clock.now(), event, &mut self.outputs);
            let outputs = std::mem::take(&mut self.outputs);
            for output in &outputs {
                match *output {
                    Output::Play { index, due } => self.play(index, due)?,
                    Output::Jumped { to } => self.jump(to)?,
                    // What vanished with the last messages in its hands has not shown them.
                    Output::Ended => return self.target.look(),
                }
            }
            self.outputs = outputs;
            self.outputs.clear();
            self.prepare()?;
        }
    }

    /// The next key or the deadline, whichever comes first; `None` when it shall end. An error if the target vanished,
    /// also while it is paused.
    fn next_event(&mut self) -> anyhow::Result<Option<Event>> {
        let silent = never();
        loop {
            let now = Instant::now();
            if now.duration_since(self.looked) >= REFRESH {
                self.looked = now;
                self.target.look()?;
            }
            let keys = self.keyboard.as_ref().map_or(&silent, Keyboard::keys);
            let refresh = now + REFRESH;
            let due = self.player.deadline().map(|due| self.clock.instant(due));
            let until = due.map_or(refresh, |due| due.min(refresh));
            self.draw();
            let key = select! {
                recv(self.interrupted) -> _ => Some(Key::Quit),
                recv(keys) -> key => key.ok(),
                default(until.saturating_duration_since(now)) => None,
            };
            match key {
                Some(Key::Quit) => return Ok(None),
                Some(Key::Player(event)) => return Ok(Some(event)),
                None if due == Some(until) || until <= now => return Ok(Some(Event::Wake)),
                None => {}
            }
        }
    }

    fn play(&mut self, index: usize, due: Stamp) -> anyhow::Result<()> {
        let Some(message) = self.fetch(index)? else {
            return Ok(());
        };
        self.target.play(message)?;
        // After that, so that what the target took for it counts.
        if self.late.len() < LATE_KEPT {
            self.late.push(self.clock.now().since(due));
        }
        self.played += 1;
        Ok(())
    }

    fn fetch(&mut self, index: usize) -> anyhow::Result<Option<Recorded>> {
        if let Some((_, message)) = self.ready.take_if(|(ready, _)| *ready == index) {
            return Ok(Some(message));
        }
        let place = self.messages.get(index);
        Ok(place.map(|place| self.reel.fetch(place)).transpose()?)
    }

    fn prepare(&mut self) -> anyhow::Result<()> {
        let next = self.player.next();
        if let Some(message) = self.fetch(next)? {
            self.ready = Some((next, message));
        }
        Ok(())
    }

    fn jump(&mut self, to: usize) -> anyhow::Result<()> {
        self.passes += 1;
        self.target.begin_again()?;
        self.show_what_holds(to)
    }

    /// Whoever looks from here on needs the surroundings, the trial and the forecast that hold here.
    fn show_what_holds(&mut self, here: usize) -> anyhow::Result<()> {
        let before = self.messages.get(..here).unwrap_or_default();
        let newest = |topic: &Topic| before.iter().rposition(|message| message.topic == *topic);
        let topics = [Topic::Scene, Topic::Trial, Topic::Forecast];
        let mut lasting: Vec<usize> = topics.iter().filter_map(newest).collect();
        lasting.sort_unstable();
        for index in lasting {
            if let Some(message) = self.fetch(index)? {
                self.target.play(message)?;
            }
        }
        self.prepare()
    }

    fn draw(&self) {
        let now = self.clock.now();
        self.bar.set_position(self.player.position(now) / 1_000_000);
        self.bar.set_message(status(&self.player, now));
    }

    /// Closes the target and says how it went.
    pub(super) fn end(mut self) -> Report {
        self.bar.finish_and_clear();
        self.keyboard = None;
        self.late.sort_unstable();
        let closing = self.target.close();
        Report {
            played: self.played,
            passes: self.passes,
            is_paced: self.player.speed() != Speed::Max,
            lost: closing.lost,
            was_there: closing.was_there,
            late: self.late,
        }
    }
}

/// Where it is, how fast, and which part is played how often.
fn status(player: &Player, now: Stamp) -> String {
    let speed = match player.speed() {
        _ if player.is_paused() => "paused".to_owned(),
        Speed::Max => "max".to_owned(),
        Speed::PerMille(speed) => format!("× {}", f64::from(speed) / 1000.0),
    };
    let part = player.part().map_or_else(String::new, |(from, until)| {
        format!("  [{:.1}, {:.1}]", seconds(from), seconds(until))
    });
    let repeats = if player.repeats() { "  loop" } else { "" };
    let (at, end) = (seconds(player.position(now)), seconds(player.end()));
    format!("{at:.1} of {end:.1} s  {speed}{part}{repeats}")
}

#[cfg(test)]
mod tests {
    use tandem_wire::SECOND;

    use super::*;
    use crate::replay::player::Plan;

    #[test]
    fn the_line_says_which_part_is_played_and_whether_it_loops() {
        let plan = Plan {
            from: 0,
            until: u64::MAX,
            speed: Speed::PerMille(500),
            repeats: false,
            paused: false,
        };
        let mut player = Player::new(vec![0, 2 * SECOND, 9 * SECOND], plan, Stamp(0));
        assert_eq!(status(&player, Stamp(SECOND)), "0.5 of 9.0 s  × 0.5");
        for event in [Event::FromHere, Event::ToggleLoop, Event::Toggle] {
            player.step(Stamp(2 * SECOND), event, &mut Vec::new());
        }
        let line = status(&player, Stamp(3 * SECOND));
        assert_eq!(line, "1.0 of 9.0 s  paused  [1.0, 9.0]  loop");
    }
}
