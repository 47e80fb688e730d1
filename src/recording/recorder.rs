//! A recording: a narrator whose sink is an MCAP file.

use super::Clock;
use super::file::{Channel, McapFile, RecordError};
use super::narrator::{Narrator, Told};
use super::topics::{Sink, Times, Topic};
use std::collections::BTreeMap;
use std::path::Path;

/// Writes what is perceived into an MCAP file.
pub type Recorder = Narrator<Recording>;

/// The file with a channel for every topic.
pub struct Recording {
    file: McapFile,
    channels: [Channel; Topic::ALL.len()],
}

impl Sink for Recording {
    type Error = RecordError;

    fn wants(&self, _: Topic) -> bool {
        true
    }

    fn write(&mut self, topic: Topic, times: Times, bytes: &[u8]) -> Result<(), RecordError> {
        self.file.write(self.channels[topic as usize], times, bytes)
    }
}

/// The content of a finished recording, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recorded {
    /// What it tells of.
    pub told: Told,
    /// Messages in all channels.
    pub messages: u64,
    /// Length of the file.
    pub bytes: u64,
}

impl Recorder {
    /// Starts a file, which takes the place of one that is there when it is finished; `notes` go into its metadata record `beo`.
    ///
    /// # Errors
    /// [`RecordError`] if it cannot be written.
    pub fn create(path: &Path, mut notes: BTreeMap<String, String>) -> Result<Self, RecordError> {
        let (mut file, clock) = (McapFile::create(path)?, Clock::now());
        // The first is at the place of every topic until its own is there.
        let mut channels = [file.channel(Topic::ALL[0])?; Topic::ALL.len()];
        for topic in &Topic::ALL[1..] {
            channels[*topic as usize] = file.channel(*topic)?;
        }
        notes.insert("monotonic_to_unix_ns".into(), clock.offset_ns().to_string());
        file.note("beo", notes)?;
        Ok(Self::new(Recording { file, channels }, clock, None))
    }

    /// Where the recording is until it is finished.
    pub fn path(&self) -> &Path {
        self.sink.file.path()
    }

    /// Hands everything to the operating system.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn flush(&mut self) -> Result<(), RecordError> {
        self.sink.file.flush()
    }

    /// Ends the file.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn finish(self) -> Result<Recorded, RecordError> {
        let told = self.told();
        let (messages, bytes) = self.into_sink().file.finish()?;
        Ok(Recorded { told, messages, bytes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pipe_takes_a_whole_recording_and_a_device_loses_one_without_complaint() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pipe");
        let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
        rustix::fs::mknodat(rustix::fs::CWD, &path, rustix::fs::FileType::Fifo, mode, 0).unwrap();
        let record = |path: &Path| {
            let mut recorder = Recorder::create(path, BTreeMap::new()).unwrap();
            for line in ["one", "two"] {
                recorder.say(line, 5).unwrap();
                recorder.flush().unwrap();
            }
            recorder.finish().unwrap()
        };
        let other_end = std::thread::spawn({
            let path = path.clone();
            move || std::fs::read(path)
        });
        let recorded = record(&path);
        let bytes = other_end.join().unwrap().unwrap();
        assert_eq!((recorded.messages, recorded.bytes), (2, bytes.len() as u64));
        assert_eq!(mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).count(), 2);
        assert!(mcap::Summary::read(&bytes).unwrap().is_some());
        assert_eq!(record(Path::new("/dev/null")), recorded);
    }
}
