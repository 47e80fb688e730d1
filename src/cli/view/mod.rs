//! `beo view`: shows live what the daemon perceives.
//!
//! | file | what |
//! | --- | --- |
//! | `layout.json` | a layout for Foxglove and Lichtblick |
//! | `page` | a page for browsers, and the server of its files |

mod page;

use super::connecting::Connecting;
use super::failure::Failure;
use super::narrating::Narrating;
use super::observe::seconds;
use super::stop;
use crate::recording::{Clock, Live, Narrator};
use beo_ipc::{InstanceName, Subscriber, SubscriberOptions};
use clap::Args;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Show live what the daemon perceives, in Foxglove, Lichtblick or a browser
///
/// A WebSocket server with the topics of `beo record`: what was seen, the completion coloured and more transparent where unsure, box, pose
/// hypotheses, classes as bars, the camera's depth image with the objects found, health and latencies. In the viewer choose "Open connection", "Foxglove WebSocket", and the printed address.
/// Topics are not shown until they are chosen: the layout of --layout chooses them. For who has no viewer, --web serves a page that shows the
/// same. Slow viewers miss frames, and delay nobody.
#[derive(Args)]
pub struct View {
    /// Instance of the daemon
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    instance: InstanceName,
    /// Port to listen on; 0 for any that is free
    #[arg(long, default_value_t = 8765, value_name = "PORT")]
    port: u16,
    /// Address to listen on: whoever reaches it sees everything, without a password
    #[arg(long, default_value = "127.0.0.1", value_name = "ADDRESS")]
    host: String,
    /// Serve a page for browsers as well, on this port [8766 where none is named]
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "8766")]
    web: Option<u16>,
    /// Print a layout for Foxglove and Lichtblick, and end
    #[arg(long, conflicts_with_all = ["instance", "port", "host", "web", "keep", "wait"])]
    layout: bool,
    /// Seconds after which an object that is not perceived again disappears
    #[arg(long, default_value_t = 10.0, value_name = "SECONDS")]
    keep: f64,
    /// Seconds to wait for a daemon
    #[arg(long, default_value_t = 10.0, value_name = "SECONDS")]
    wait: f64,
}

/// Panels with the topics in them.
const LAYOUT: &str = include_str!("layout.json");
/// The longest that an interrupt is not seen.
const LOOK: Duration = Duration::from_millis(20);
/// The longest wait for viewers' goodbyes.
const GOODBYE: Duration = Duration::from_millis(40);

impl View {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        if self.layout {
            say!("{}", LAYOUT.trim_end());
            return Ok(());
        }
        let wait = seconds(self.wait)?;
        let keep = Duration::try_from_secs_f64(self.keep).ok().filter(|keep| !keep.is_zero());
        let keep = keep.ok_or_else(|| Failure::Usage(format!("--keep {}: use a number above 0", self.keep)))?;
        let stop = stop::on_signal()?;
        let live = Live::start(&self.host, self.port, &format!("beo {}", self.instance))?;
        let page = self.web.map(|port| page::serve(&self.host, port, live.port())).transpose()?;
        let url = live.url();
        let connecting = Connecting::within(wait, &self.instance, &stop);
        let subscriber = connecting.open(|| Subscriber::open(&self.instance, &SubscriberOptions { completion: true }))?;
        let status = connecting.status(&subscriber)?;
        let mut narrator = Narrator::new(live, Clock::now(), Some(keep));
        let mut narrating = Narrating::begin(&self.instance, subscriber, status, &mut narrator)?;
        say!("viewing `{}` at {url} (Foxglove or Lichtblick: Open connection, Foxglove WebSocket)", self.instance);
        say!("layout: beo view --layout >beo-layout.json, then in the viewer: Layouts, Import from file");
        if let Some(address) = page {
            say!("in a browser: http://{address}");
        }
        while !stop.load(Ordering::Relaxed) {
            narrating.wait(LOOK)?;
            // What was seen is taken from the completions: the one place beside the daemon for reading observations is a recorder's.
            while !stop.load(Ordering::Relaxed) && narrating.answer(&mut narrator, true)? {}
            narrating.pictures(&mut narrator)?;
            narrating.maintain(&mut narrator)?;
        }
        narrator.into_sink().stop(GOODBYE);
        if let Some(missed) = narrating.missed() {
            warn!("missed {missed}");
        }
        Ok(())
    }
}
