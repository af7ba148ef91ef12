//! Real time: a node has its turn on whichever thread has something for it.
//!
//! ```text
//!   Zenoh's thread ──put──▶ queue ──ring──┬─ OnArrival: takes its turn here, if nobody else has it
//!                                         └─ Own, InBatches: wakes the node's thread
//!   the node's thread: takes its turn, sleeps until the next deadline
//! ```
//!
//! Who has the turn takes up everything that waits. Who finds it taken leaves: whoever has it looks into the queue once more
//! after giving it away. So nothing is left lying, nobody ever waits for a step, and a message that a node's own word brings
//! back to it, within its step, waits for the end of that step.

use std::sync::atomic::{Ordering, fence};
use std::sync::{Mutex, OnceLock, TryLockError};
use std::thread::Thread;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError};
use tandem_wire::{Delivery, Input, Ports, Stamp, Turn};

use crate::entrance::Bell;
use crate::running::{Item, Report};
use crate::shell::Shell;
use crate::spool::LINGER;

/// For so long inputs may gather before a node that works in batches takes them up.
const GATHER: Duration = Duration::from_millis(5);

/// Where a node's turn is taken.
pub(crate) struct Post<N: Ports, F> {
    place: Mutex<Option<At<N, F>>>,
    queue: Receiver<Item>,
    thread: OnceLock<Thread>,
}

/// A shell at its post.
struct At<N: Ports, F> {
    shell: Shell<N, F>,
    /// When its thread wakes by itself.
    alarm: Option<Stamp>,
    /// Whether it was asked to end, which its own thread does.
    ends: bool,
}

impl<N, F> Bell for Post<N, F>
where
    N: Ports + Send,
    N::Output: Send,
    F: FnMut(Stamp, N::Output) + Send,
{
    fn ring(&self) {
        match N::TURN {
            Turn::OnArrival => self.take_turn(),
            Turn::Own | Turn::InBatches => self.wake_thread(),
        }
    }
}

impl<N: Ports, F: FnMut(Stamp, N::Output)> Post<N, F> {
    /// A post with nobody at it yet; what comes waits.
    pub(crate) const fn new(queue: Receiver<Item>) -> Self {
        Self {
            place: Mutex::new(None),
            queue,
            thread: OnceLock::new(),
        }
    }

    fn wake_thread(&self) {
        if let Some(thread) = self.thread.get() {
            thread.unpark();
        }
    }

    /// On a thread that brought something.
    fn take_turn(&self) {
        loop {
            let mut place = match self.place.try_lock() {
                Ok(place) => place,
                Err(TryLockError::WouldBlock) => return,
                // A step has panicked, which its thread passes on.
                Err(TryLockError::Poisoned(_)) => return self.wake_thread(),
            };
            let Some(at) = place.as_mut() else { return };
            at.take_up(&self.queue);
            if at.ends || at.brings_alarm_forward() {
                self.wake_thread();
            }
            let ends = at.ends;
            drop(place);
            if ends || self.is_nothing_left() {
                return;
            }
        }
    }

    /// After the turn was given away: whoever found it taken has put something in before.
    fn is_nothing_left(&self) -> bool {
        // Giving away must not be reordered behind looking, as little as putting in behind finding it taken.
        fence(Ordering::SeqCst);
        self.queue.is_empty()
    }

    /// The life of the node's own thread.
    pub(crate) fn live(&self, mut shell: Shell<N, F>) -> Report {
        // Nobody else sets it.
        let _ = self.thread.set(std::thread::current());
        shell.now = shell.clock.now();
        shell.keep_snapshot();
        let clock = shell.clock;
        let mut mine = Some(At {
            shell,
            alarm: None,
            ends: false,
        });
        loop {
            let mut place = self.place.lock().expect("no step panics, on whatever thread");
            let at = place.get_or_insert_with(|| mine.take().expect("only this thread takes it away, and then ends"));
            at.take_up(&self.queue);
            at.wake_if_due();
            if at.ends {
                let at = place.take().expect("it is there");
                drop(place);
                return at.shell.hear_out(&self.queue).end(None);
            }
            at.alarm = at.next_alarm();
            let alarm = at.alarm.map(|stamp| clock.instant(stamp));
            drop(place);
            self.rest(alarm);
        }
    }

    /// Until there is something to do.
    fn rest(&self, alarm: Option<Instant>) {
        if self.is_nothing_left() {
            sleep_until(alarm);
        }
        let is_half_full = self.queue.capacity().is_some_and(|most| 2 * self.queue.len() >= most);
        if N::TURN == Turn::InBatches && !is_half_full {
            std::thread::sleep(GATHER);
        }
    }
}

/// Or until woken.
fn sleep_until(instant: Option<Instant>) {
    match instant {
        Some(instant) => std::thread::park_timeout(instant.saturating_duration_since(Instant::now())),
        None => std::thread::park(),
    }
}

impl<N: Ports, F: FnMut(Stamp, N::Output)> At<N, F> {
    /// Takes up what waits now. What comes meanwhile has another turn, so that a flood delays no deadline.
    fn take_up(&mut self, queue: &Receiver<Item>) {
        for _ in 0..queue.len() {
            if self.ends {
                return;
            }
            let Ok(item) = queue.try_recv() else { return };
            self.ends = self.shell.take(item);
        }
    }

    fn wake_if_due(&mut self) {
        let shell = &mut self.shell;
        while shell.line.deadline().is_some()
            && let Some((_, topic, bytes)) = shell.line.due(shell.clock.now())
        {
            shell.step_now(Input::Sample { topic, bytes: &bytes });
        }
        if shell.node.deadline().is_some_and(|due| due <= shell.clock.now()) {
            shell.step_now(Input::Wake);
        }
    }

    fn next_alarm(&self) -> Option<Stamp> {
        let deadlines = [self.shell.node.deadline(), self.shell.line.deadline()];
        deadlines.into_iter().flatten().min()
    }

    /// Whether the thread would sleep for too long.
    fn brings_alarm_forward(&mut self) -> bool {
        let next = self.next_alarm();
        let sooner = next.is_some_and(|next| self.alarm.is_none_or(|alarm| next < alarm));
        if sooner {
            self.alarm = next;
        }
        sooner
    }
}

impl<N: Ports, F: FnMut(Stamp, N::Output)> Shell<N, F> {
    /// Takes up an item; says whether it was the wish to end.
    fn take(&mut self, item: Item) -> bool {
        if self.is_late(&item) {
            self.late += 1;
            return false;
        }
        if self.loses(&item) {
            return false;
        }
        let is_end = matches!(item, Item::Stop);
        match item {
            // A bad line keeps samples back before the journal sees them: what stands in it is what the node saw.
            Item::Sample { topic, bytes, .. } if self.line.is_bad() => {
                if let Some(bytes) = self.line.take(self.clock.now(), topic, bytes) {
                    self.step_now(Input::Sample { topic, bytes: &bytes });
                }
            }
            Item::Sample { topic, bytes, arrived } if N::TURN == Turn::InBatches => {
                let wall = self.clock.now();
                self.step(self.now.max(arrived), wall, Input::Sample { topic, bytes: &bytes });
            }
            item => self.step_now(item.input()),
        }
        is_end
    }

    fn step_now(&mut self, input: Input<'_>) {
        let now = self.clock.now();
        self.step(now, now, input);
    }

    /// Whether a stream's sample has waited here for so long that the stream counts as lost. It would look fresh to the
    /// node, which is stepped with the time at which it takes a sample up. A node that works in batches decides nothing: it
    /// hears all.
    fn is_late(&self, item: &Item) -> bool {
        let Item::Sample { topic, arrived, .. } = item else {
            return false;
        };
        N::TURN != Turn::InBatches
            && topic.delivery() == Delivery::Stream
            && self.clock.now().since(*arrived) > self.options.timing.stream_timeout()
    }

    /// A node that was asked to end and waits for something hears it, for a bounded time.
    fn hear_out(mut self, queue: &Receiver<Item>) -> Self {
        let until = self.clock.now().after(LINGER);
        while self.node.lingers() && self.clock.now() < until {
            let next = self.node.deadline().map_or(until, |due| due.min(until));
            match queue.recv_deadline(self.clock.instant(next)) {
                Ok(Item::Stop) | Err(RecvTimeoutError::Disconnected) => break,
                Ok(item) => self.step_now(item.input()),
                Err(RecvTimeoutError::Timeout) => self.step_now(Input::Wake),
            }
        }
        if self.node.lingers() {
            self.step_now(Input::Stop);
        }
        self
    }
}
