//! The MCAP file: its channels, what is written to them, and its end.
//!
//! Chunks are not compressed: completions of 30³ voxels take about a third of a megabyte each. Until it is finished the file has its name
//! with `.partial` after it. One that is not finished (the process was killed, the disk is full) keeps that name and lacks its index; readers
//! that scan it find all that was flushed.

use super::topics::{EncodeError, Times, Topic};
use beo_core::whole_file::WholeFile;
use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::io::{self, BufWriter, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// A recording that cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be written.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The file, or its partial name.
        path: PathBuf,
        /// The words of the operating system or the encoder.
        cause: String,
    },
    /// A message has no encoding.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// There is no more room.
    #[error(
        "{} is incomplete: the disk is full after {messages} messages; free some space and record again (what was flushed can be read by \
         scanning the file, as `mcap recover` does)",
        path.display()
    )]
    DiskFull {
        /// The file, or its partial name.
        path: PathBuf,
        /// Messages that were taken before.
        messages: u64,
    },
}

/// A channel of the file.
#[derive(Clone, Copy, Debug)]
pub struct Channel(u16);

/// The file being written.
pub struct McapFile {
    /// Where it is: its partial name, or a pipe's or device's own.
    path: PathBuf,
    /// Taken out when the file has ended, well or badly.
    writer: Option<Writer<BufWriter<Sink>>>,
    fault: Fault,
    messages: u64,
    sequences: BTreeMap<u16, u32>,
}

/// The first error of the system: the encoder passes on some of its errors as its own, without their cause.
type Fault = Arc<OnceLock<(ErrorKind, String)>>;

/// The file, whose first error is remembered.
struct Sink {
    file: WholeFile,
    /// Bytes so far.
    written: u64,
    fault: Fault,
}

impl Sink {
    fn noting<T>(&self, outcome: io::Result<T>) -> io::Result<T> {
        if let Err(error) = &outcome
            && error.kind() != ErrorKind::Interrupted
        {
            let _ = self.fault.set((error.kind(), error.to_string()));
        }
        outcome
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let outcome = self.file.write(bytes);
        self.written += outcome.as_ref().map_or(0, |count| *count as u64);
        self.noting(outcome)
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = self.file.flush();
        self.noting(flushed)
    }
}

impl Seek for Sink {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        let place = match (is_stream(&self.file), position) {
            // Where a pipe or device is, it does not say.
            (true, SeekFrom::Current(0)) => Ok(self.written),
            (true, _) => Err(ErrorKind::NotSeekable.into()),
            (false, position) => self.file.seek(position),
        };
        self.noting(place)
    }
}

/// Whether it is a pipe or a device, in which there is no going back: chunks are then held until they are whole.
fn is_stream(file: &WholeFile) -> bool {
    file.temporary().is_none()
}

/// The name of this program in the file's header.
const WRITTEN_BY: &str = concat!("beo ", env!("CARGO_PKG_VERSION"));

impl McapFile {
    /// Starts a file, which takes the place of one that is there when it is finished.
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        let fault = Fault::default();
        let cannot_write = |error: io::Error| failure(path, 0, &fault, &error.into());
        let file = WholeFile::create_recoverable(path).map_err(cannot_write)?;
        let is_stream = is_stream(&file);
        let path = file.temporary().unwrap_or(path).to_owned();
        let sink = BufWriter::new(Sink { file, written: 0, fault: fault.clone() });
        let mut started = Self { path, writer: None, fault, messages: 0, sequences: BTreeMap::new() };
        let options = WriteOptions::library(WriteOptions::new(), WRITTEN_BY);
        match options.disable_seeking(is_stream).create(sink) {
            Ok(writer) => started.writer = Some(writer),
            Err(error) => return Err(started.ended_by(&error)),
        }
        Ok(started)
    }

    /// Where the recording is until it is finished.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A channel of a topic, with its schema.
    pub fn channel(&mut self, topic: Topic) -> Result<Channel, RecordError> {
        let schema = topic.schema();
        self.with(|writer| {
            let id = match &schema {
                Some(schema) => writer.add_schema(&schema.name, &schema.encoding, &schema.data)?,
                None => 0,
            };
            writer.add_channel(id, topic.name(), topic.encoding(), &BTreeMap::new())
        })
        .map(Channel)
    }

    /// Notes beside the messages.
    pub fn note(&mut self, name: &str, notes: BTreeMap<String, String>) -> Result<(), RecordError> {
        self.with(|writer| writer.write_metadata(&Metadata { name: name.into(), metadata: notes }))
    }

    /// Writes a message.
    pub fn write(&mut self, channel: Channel, times: Times, bytes: &[u8]) -> Result<(), RecordError> {
        let sequence = self.sequences.entry(channel.0).or_insert(0);
        *sequence = sequence.wrapping_add(1);
        let header =
            MessageHeader { channel_id: channel.0, sequence: *sequence, log_time: times.logged_ns, publish_time: times.captured_ns };
        self.with(|writer| writer.write_to_known_channel(&header, bytes))?;
        self.messages += 1;
        Ok(())
    }

    /// Hands everything to the operating system: it is there even if this process is killed.
    pub fn flush(&mut self) -> Result<(), RecordError> {
        self.with(Writer::flush)
    }

    /// Writes the index, brings the file to the disk and gives it its name; messages in it and its length.
    pub fn finish(mut self) -> Result<(u64, u64), RecordError> {
        self.with(|writer| writer.finish().map(|_| ()))?;
        let writer = self.writer.take().ok_or_else(|| ended(&self.path))?;
        let keep = |writer: Writer<BufWriter<Sink>>| {
            let sink = writer.into_inner().into_inner().map_err(io::IntoInnerError::into_error)?;
            let bytes = if is_stream(&sink.file) { sink.written } else { sink.file.file().metadata()?.len() };
            sink.file.keep()?;
            Ok::<_, io::Error>(bytes)
        };
        let bytes = keep(writer).map_err(|error| failure(&self.path, self.messages, &self.fault, &error.into()))?;
        Ok((self.messages, bytes))
    }

    /// Does something with the writer. After an error it is used no more: it would fail in the middle of a record.
    fn with<T>(&mut self, work: impl FnOnce(&mut Writer<BufWriter<Sink>>) -> Result<T, McapError>) -> Result<T, RecordError> {
        let writer = self.writer.as_mut().ok_or_else(|| ended(&self.path))?;
        work(writer).map_err(|error| {
            // Ending it in its own way would write once more.
            drop(self.writer.take().map(Writer::into_inner).map(BufWriter::into_parts));
            self.ended_by(&error)
        })
    }

    /// The error that is reported of one that ended the file. A file without a message is of no use to anybody, and goes.
    fn ended_by(&self, error: &McapError) -> RecordError {
        if self.messages == 0 && self.path.is_file() {
            let _ = std::fs::remove_file(&self.path);
        }
        failure(&self.path, self.messages, &self.fault, error)
    }
}

fn ended(path: &Path) -> RecordError {
    RecordError::Write { path: path.into(), cause: "it ended with an earlier error".into() }
}

fn failure(path: &Path, messages: u64, fault: &Fault, error: &McapError) -> RecordError {
    let (kind, cause) = match (fault.get(), error) {
        (Some((kind, cause)), _) => (Some(*kind), cause.clone()),
        (None, McapError::Io(error)) => (Some(error.kind()), error.to_string()),
        (None, error) => (None, error.to_string()),
    };
    match kind {
        Some(ErrorKind::StorageFull) => RecordError::DiskFull { path: path.into(), messages },
        _ => RecordError::Write { path: path.into(), cause },
    }
}
