//! Putting a node to work: what it declares, the threads around it, and the loop of its pace.

use std::sync::Arc;

use crossbeam_channel::bounded;
use tandem_wire::{NodeName, Pace, Ports, Stamp, Topic};

use crate::answer::Asker;
use crate::clocks::Clocks;
use crate::declared::Declared;
use crate::dropped::Dropped;
use crate::entrance::{Bell, Door, Entrance};
use crate::journal::Journal;
use crate::net::{Link, LinkError};
use crate::real::Post;
use crate::running::{Running, ShellOptions};
use crate::shell::{Shell, Voice};

/// Puts `node` to work. `local` is given every output, those that stay in the process included, on whichever thread takes
/// the step; it must not block.
///
/// # Errors
/// If Zenoh refuses a declaration or the system a thread.
pub fn spawn<N, F>(link: &Link, node: N, options: ShellOptions, local: F) -> Result<Running, LinkError>
where
    N: Ports + Send + 'static,
    N::Output: Send,
    F: FnMut(Stamp, N::Output) + Send + 'static,
{
    // A queue without a place would hand over nothing.
    let (sender, queue) = bounded(options.queue.max(1));
    let dropped = Dropped::default();
    let pace = options.timing.pace;
    let post = Arc::new(Post::new(queue.clone()));
    let bell = match pace {
        Pace::Real => Some(Arc::clone(&post) as Arc<dyn Bell>),
        Pace::Lockstep => None,
    };
    let door = Door { sender, bell };
    let entrance = Entrance {
        door: door.clone(),
        oldest: queue.clone(),
        dropped: dropped.clone(),
    };
    let publishers = N::OUTPUTS
        .iter()
        .map(|&topic| Ok((topic, link.publisher(topic, pace)?)))
        .collect::<Result<_, LinkError>>()?;
    let journal = match N::NAME {
        // The recorder's inputs are the recording itself.
        NodeName::Recorder => None,
        _ => Some(Journal::start(link, N::NAME, &options)?),
    };
    let clocks = match pace {
        Pace::Real => Some(Clocks::start(link, N::NAME, options.info.session, &options.clocks)?),
        // Stamps are no times.
        Pace::Lockstep => None,
    };
    let declared = Declared::new::<N>(link, &entrance, &options)?;
    let voice = Voice {
        publishers,
        journal,
        asker: Asker::new(link, entrance),
        local,
        spoke: false,
        bytes: Vec::new(),
    };
    let shell = Shell::new(node, options, voice);
    let counted = dropped.clone();
    let work = move || {
        let mut report = match pace {
            Pace::Real => post.live(shell),
            Pace::Lockstep => shell.live_in_lockstep(&queue),
        };
        drop(declared);
        drop(clocks);
        report.dropped += counted.total();
        report
    };
    let thread = std::thread::Builder::new().name(N::NAME.as_str().into()).spawn(work);
    let thread = thread.map_err(|error| LinkError::Declare {
        key: Topic::Alive(N::NAME).key(&link.robot),
        reason: error.to_string(),
    })?;
    Ok(Running { door, dropped, thread })
}
