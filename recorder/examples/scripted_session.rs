//! Writes the tests' scripted session as `scripted.mcap` and `scripted.rrd`, to look at.
//!
//! `scripted_session FOLDER [none | spawn | VIEWER-URL] [SECONDS]`

#[path = "../tests/it/script/mod.rs"]
mod script;

use std::time::Duration;

use tandem_recorder::{Live, Provenance, RecorderConfig, RecorderSettings, Sinks};
use tandem_wire::Timing;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| ".".into());
    let live = std::env::args().nth(2);
    let mut settings = RecorderSettings {
        path: format!("{folder}/scripted.mcap"),
        rrd: format!("{folder}/scripted.rrd"),
        overwrite: true,
        ..RecorderSettings::default()
    };
    match live.as_deref() {
        Some("spawn") => settings.live = Live::Spawn,
        None | Some("none") => {}
        Some(url) => {
            settings.live = Live::Connect;
            settings.viewer = url.into();
        }
    }
    let seconds: u64 = std::env::args().nth(3).map_or(Ok(u64::MAX), |text| text.parse())?;
    let provenance = Provenance {
        robot: "panda".parse()?,
        build: env!("CARGO_PKG_VERSION").into(),
        epoch_unix_nanos: 1_760_000_000_000_000_000,
    };
    let timing = Timing::default().lockstep();
    let mut sinks = Sinks::open(&RecorderConfig::new(&settings)?, timing, &provenance)?;
    let mut samples = script::session();
    samples.retain(|sample| sample.at.seconds() <= seconds as f64);
    for output in script::record(&samples, timing) {
        sinks.handle(output);
        if live.is_some() {
            // As slow as a live session roughly is, so that the viewer is seen to follow.
            crossbeam_channel::after(Duration::from_millis(5)).recv()?;
        }
    }
    println!("{:#?}", sinks.close(Duration::from_secs(5)));
    Ok(())
}
