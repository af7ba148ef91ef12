//! A trial with a person: lines between trials, keys during one.
//!
//! Lines are read one at a time and only while one is awaited, so that during a trial all keys belong to the robot.

use std::io::{BufRead as _, IsTerminal as _};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, bounded, select};
use tandem_operator::{DeviceSample, keyboard};
use tandem_trials::plan::{Participant, Slot};

use super::console::{Console, Heard, Order, Verdict};
use super::run::{Next, Run, judge};
use super::stage::{Driven, End, Following};
use crate::summary::progress;

/// A line longer than this is cut; nobody types one.
const LINE_MAX: usize = 10_000;

pub(super) fn check_terminal() -> anyhow::Result<()> {
    if std::io::stdin().is_terminal() && std::io::stdout().is_terminal() {
        Ok(())
    } else {
        Err(keyboard::KeyboardError::NotATerminal.into())
    }
}

/// Offers a trial to the person.
pub(super) fn trial(run: &mut Run<'_>, participant: &Participant, slot: &Slot, of: usize) -> anyhow::Result<Next> {
    let (mut console, orders) = Console::offer(title(run, participant, slot, of));
    let mut waiting: Vec<Order> = orders;
    let mut driven: Option<Driven> = None;
    let mut next = Next::Again;
    loop {
        let mut heard = None;
        for order in waiting.drain(..) {
            match order {
                Order::Say(text) => println!("{text}"),
                Order::Drive => {
                    let trial = run.drive(participant, slot, steer)?;
                    if trial.end == End::Interrupted {
                        return Ok(Next::Stop("interrupted"));
                    }
                    heard = Some(outcome(run, &trial));
                    driven = Some(trial);
                }
                Order::Record(verdict) => {
                    if let Some(driven) = &driven {
                        next = run.record(participant, slot, driven, verdict)?;
                    }
                }
                Order::Leave => return Ok(Next::Stop("stopped by the person")),
            }
        }
        if console.is_done() {
            if next == Next::Trial {
                let pause = run.prepared.plan.pause_after(u64::from(slot.number));
                if rest(pause, &run.interrupted).is_break() {
                    return Ok(Next::Stop("interrupted"));
                }
            }
            return Ok(next);
        }
        let heard = match heard {
            Some(heard) => heard,
            None if console.awaits_line() => match read_line(&run.interrupted) {
                Some(heard) => heard,
                None => return Ok(Next::Stop("interrupted")),
            },
            // Unreachable as the console is drawn; leaving is the harmless way out.
            None => return Ok(Next::Stop("stopped")),
        };
        waiting = console.hear(heard);
    }
}

fn title(run: &Run<'_>, participant: &Participant, slot: &Slot, of: usize) -> String {
    let context = &run.prepared.plan.contexts[slot.context];
    let label = match context.settings.label.as_str() {
        "" => &context.name,
        label => label,
    };
    let practice = if slot.practice { " (practice)" } else { "" };
    // The condition stays untold: who knows the law drives otherwise.
    format!("{participant}: trial {} of {of}{practice}: {label}", slot.number)
}

fn outcome(run: &Run<'_>, driven: &Driven) -> Heard {
    match &driven.end {
        End::Aborted(why) => Heard::Aborted(why.clone()),
        End::Left { repeat: true } => Heard::Aborted("repeated at the person's wish".to_owned()),
        End::Left { repeat: false } => Heard::Aborted("the person left it".to_owned()),
        _ => {
            let Verdict { outcome, reason, .. } = judge(&run.prepared.plan.success, driven);
            Heard::Ended { outcome, reason }
        }
    }
}

/// Hands the terminal to the robot until the trial ends.
fn steer(following: &mut Following<'_>) -> anyhow::Result<End> {
    let Some(device) = following.operator().map(tandem_link::Running::device) else {
        return Ok(End::Aborted("there is no operator".to_owned()));
    };
    let status = std::cell::RefCell::new(String::new());
    let mut ended = None;
    let send = |bytes: Vec<u8>| {
        let sample = DeviceSample::from_bytes(&bytes).unwrap_or_default();
        // The run numbers trials; a key that asks for another one asks for this one again.
        let silent = DeviceSample { requests: 0, ..sample };
        // A full queue drops the sample; the node counts a silent device as released.
        let _ = device.send(silent.to_bytes().to_vec());
        if sample.requests > 0 && ended.is_none() {
            ended = Some(End::Left { repeat: true });
        }
        let until = Instant::now() + Duration::from_millis(1);
        while ended.is_none() && Instant::now() < until {
            ended = following.poll(Duration::from_millis(1));
        }
        *status.borrow_mut() = progress(following.tracer());
        match ended {
            Some(_) => ControlFlow::Break(()),
            None => ControlFlow::Continue(()),
        }
    };
    let left = keyboard::run(send, || status.borrow().clone())?;
    println!();
    Ok(match (ended, left) {
        (Some(end), _) => end,
        (None, _) => End::Left { repeat: false },
    })
}

/// The next line; `None` if the program shall end.
fn read_line(interrupted: &Receiver<()>) -> Option<Heard> {
    let (sender, line) = bounded(1);
    // Reading cannot be called off, so it has a thread that is left behind when the program ends.
    std::thread::spawn(move || {
        let mut text = String::new();
        let read = std::io::stdin().lock().read_line(&mut text);
        // Nobody may be waiting any more.
        let _ = sender.send(match read {
            Ok(0) | Err(_) => Heard::Closed,
            Ok(_) => Heard::Line(text.chars().take(LINE_MAX).collect()),
        });
    });
    select! {
        recv(line) -> line => Some(line.unwrap_or(Heard::Closed)),
        recv(interrupted) -> _ => None,
    }
}

/// A pause that is counted down; breaks if the program shall end.
fn rest(seconds: u32, interrupted: &Receiver<()>) -> ControlFlow<()> {
    for left in (1..=seconds).rev() {
        print!("\rpause: {left} s ");
        // A terminal that takes no text misses a countdown.
        let _ = std::io::Write::flush(&mut std::io::stdout());
        if interrupted.recv_timeout(Duration::from_secs(1)).is_ok() {
            return ControlFlow::Break(());
        }
    }
    if seconds > 0 {
        println!("\rpause: over ");
    }
    ControlFlow::Continue(())
}
