//! The MCAP file: its channels, what is written to them, and its end.
//!
//! Chunks are not compressed: completions of 30³ voxels take about a third of a megabyte each. A file that is not finished (the process
//! was killed) lacks its index; readers that scan it find all that was flushed.

use foxglove::Encode;
use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, ErrorKind};
use std::path::{Path, PathBuf};

/// A recording that cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be written.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the operating system or the encoder said.
        cause: String,
    },
    /// There is no more room.
    #[error(
        "{} is incomplete: the disk is full after {messages} messages; free some space and record again (what was flushed can be read by \
         scanning the file, as `mcap recover` does)",
        path.display()
    )]
    DiskFull {
        /// The file.
        path: PathBuf,
        /// Messages that were taken before.
        messages: u64,
    },
}

/// What a finished recording holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recorded {
    /// Observations.
    pub observations: u64,
    /// Completions.
    pub completions: u64,
    /// Percepts.
    pub percepts: u64,
    /// Messages in all channels.
    pub messages: u64,
    /// Length of the file.
    pub bytes: u64,
}

/// When a message was taken and when what it tells of happened, nanoseconds since 1970.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    /// When it was recorded.
    pub logged_ns: u64,
    /// When the sensor data was taken.
    pub captured_ns: u64,
}

/// A channel of the file.
#[derive(Clone, Copy, Debug)]
pub struct Channel(u16);

/// The file being written.
pub struct McapFile {
    path: PathBuf,
    /// Taken out when the file has ended, well or badly.
    writer: Option<Writer<BufWriter<File>>>,
    messages: u64,
    sequences: BTreeMap<u16, u32>,
}

/// What the file's header says of the program that wrote it.
const WRITTEN_BY: &str = concat!("beo ", env!("CARGO_PKG_VERSION"));

impl McapFile {
    /// Starts a file, in place of one that is there.
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        let writer = File::create(path)
            .map_err(McapError::from)
            .and_then(|file| WriteOptions::library(WriteOptions::new(), WRITTEN_BY).create(BufWriter::new(file)))
            .map_err(|error| failure(path, 0, &error))?;
        Ok(Self { path: path.into(), writer: Some(writer), messages: 0, sequences: BTreeMap::new() })
    }

    /// A channel of Foxglove's messages, with their published schema.
    pub fn channel<T: Encode>(&mut self, topic: &str) -> Result<Channel, RecordError> {
        let schema = T::get_schema();
        self.with(|writer| {
            let id = match &schema {
                Some(schema) => writer.add_schema(&schema.name, &schema.encoding, &schema.data)?,
                None => 0,
            };
            writer.add_channel(id, topic, &T::get_message_encoding(), &BTreeMap::new())
        })
        .map(Channel)
    }

    /// A channel of JSON with a JSON schema.
    pub fn json_channel(&mut self, topic: &str, name: &str, schema: &str) -> Result<Channel, RecordError> {
        self.with(|writer| {
            let id = writer.add_schema(name, "jsonschema", schema.as_bytes())?;
            writer.add_channel(id, topic, "json", &BTreeMap::new())
        })
        .map(Channel)
    }

    /// Notes beside the messages.
    pub fn note(&mut self, name: &str, notes: BTreeMap<String, String>) -> Result<(), RecordError> {
        self.with(|writer| writer.write_metadata(&Metadata { name: name.into(), metadata: notes }))
    }

    /// Writes one of Foxglove's messages.
    pub fn write<T: Encode>(&mut self, channel: Channel, times: Times, message: &T) -> Result<(), RecordError> {
        let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or(0));
        message.encode(&mut bytes).map_err(|error| RecordError::Write { path: self.path.clone(), cause: error.to_string() })?;
        self.write_bytes(channel, times, &bytes)
    }

    /// Writes a message that is encoded already.
    pub fn write_bytes(&mut self, channel: Channel, times: Times, bytes: &[u8]) -> Result<(), RecordError> {
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

    /// Writes the index and closes the file; messages in it and its length.
    pub fn finish(mut self) -> Result<(u64, u64), RecordError> {
        self.with(|writer| writer.finish().map(|_| ()))?;
        let mut file = self.writer.take().ok_or_else(|| ended(&self.path))?.into_inner();
        let length = std::io::Write::flush(&mut file).and_then(|()| Ok(file.get_ref().metadata()?.len()));
        let bytes = length.map_err(|error| failure(&self.path, self.messages, &error.into()))?;
        Ok((self.messages, bytes))
    }

    /// Does something with the writer. After an error it is used no more: it would fail in the middle of a record.
    fn with<T>(&mut self, work: impl FnOnce(&mut Writer<BufWriter<File>>) -> Result<T, McapError>) -> Result<T, RecordError> {
        let writer = self.writer.as_mut().ok_or_else(|| ended(&self.path))?;
        work(writer).map_err(|error| {
            // Ending it in its own way would write once more.
            drop(self.writer.take().map(Writer::into_inner).map(BufWriter::into_parts));
            failure(&self.path, self.messages, &error)
        })
    }
}

fn ended(path: &Path) -> RecordError {
    RecordError::Write { path: path.into(), cause: "it ended with an earlier error".into() }
}

fn failure(path: &Path, messages: u64, error: &McapError) -> RecordError {
    match error {
        McapError::Io(io) if io.kind() == ErrorKind::StorageFull => RecordError::DiskFull { path: path.into(), messages },
        McapError::Io(io) => RecordError::Write { path: path.into(), cause: io.to_string() },
        error => RecordError::Write { path: path.into(), cause: error.to_string() },
    }
}
