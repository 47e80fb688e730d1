//! The header of a PLY file: encoding, elements and their properties.

use super::error::{FORMAT, error};
use crate::FormatError;
use crate::lines::{Lines, found, whole, words};
use beo_core::text::printable;

/// How the entries are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    /// As text, an entry a line.
    Text,
    /// As bytes, the lowest first.
    LittleEndian,
    /// As bytes, the highest first.
    BigEndian,
}

/// A type of numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Number {
    fn of(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of one.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Whether it has a fraction.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }
}

/// What a property is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    /// One number.
    Single(Number),
    /// A count, then so many numbers.
    List {
        /// Type of the count.
        count: Number,
        /// Type of the numbers.
        item: Number,
    },
}

/// A property of an element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Property {
    pub name: String,
    pub scalar: Scalar,
}

/// A kind of entries, and how many there are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
}

/// Everything after the header.
pub(super) struct Payload<'a> {
    pub encoding: Encoding,
    pub bytes: &'a [u8],
    /// Byte of the file at which it begins.
    pub offset: usize,
    /// The same as text.
    pub lines: Lines<'a>,
}

/// The header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Header {
    pub elements: Vec<Element>,
}

fn wrong(line: usize, problem: impl Into<String>) -> FormatError {
    FormatError::Line { format: FORMAT, line, problem: problem.into() }
}

fn name(word: &[u8]) -> String {
    printable(&String::from_utf8_lossy(word)).chars().take(40).collect()
}

impl Header {
    /// The header, and the payload after it.
    pub fn read(bytes: &[u8]) -> Result<(Self, Payload<'_>), FormatError> {
        let mut lines = Lines::of(bytes, FORMAT)?;
        let first = lines.next().map(|(_, line)| line).unwrap_or_default();
        if first.trim_ascii() != b"ply" {
            return Err(wrong(1, format!("expected `ply`, {}", found(words(first).next()))));
        }
        let (mut encoding, mut elements) = (None, Vec::<Element>::new());
        loop {
            // The payload of a binary file may start with a byte that looks like a line end: after `\r` alone the file's first line says
            // whether `\n` belongs to it.
            let before = lines.rest();
            let Some((line, text)) = lines.next() else {
                return Err(error("the file ends before `end_header`: it is incomplete"));
            };
            let mut words = words(text);
            match words.next() {
                None | Some(b"comment" | b"obj_info") => {}
                Some(b"format") => {
                    let (kind, version) = (words.next(), words.next());
                    encoding = Some(match (kind, version) {
                        (Some(b"ascii"), Some(b"1.0")) => Encoding::Text,
                        (Some(b"binary_little_endian"), Some(b"1.0")) => Encoding::LittleEndian,
                        (Some(b"binary_big_endian"), Some(b"1.0")) => Encoding::BigEndian,
                        (Some(b"ascii" | b"binary_little_endian" | b"binary_big_endian"), version) => {
                            return Err(wrong(line, format!("expected version 1.0, {}", found(version))));
                        }
                        (kind, _) => {
                            let problem = format!("expected ascii, binary_little_endian or binary_big_endian, {}", found(kind));
                            return Err(wrong(line, problem));
                        }
                    });
                }
                Some(b"element") => {
                    let (kind, count) = (words.next(), words.next());
                    let problem = || wrong(line, format!("expected `element`, a name and a count, {}", found(count.or(kind))));
                    let (Some(kind), Some(count)) = (kind, count.and_then(whole::<usize>)) else { return Err(problem()) };
                    elements.push(Element { name: name(kind), count, properties: Vec::new() });
                }
                Some(b"property") => {
                    let element = elements.last_mut().ok_or_else(|| wrong(line, "`property` comes before any `element`"))?;
                    element.properties.push(property(line, words)?);
                }
                Some(b"end_header") => {
                    let encoding = encoding.ok_or_else(|| wrong(line, "the header ends without a line `format`"))?;
                    let ends_in_return = before.get(text.len()) == Some(&b'\r');
                    let file_ends_in_both = bytes.iter().position(|b| *b == b'\r').is_some_and(|at| bytes.get(at + 1) == Some(&b'\n'));
                    let payload = if ends_in_return && !file_ends_in_both { &before[text.len() + 1..] } else { lines.rest() };
                    let offset = bytes.len() - payload.len();
                    return Ok((Self { elements }, Payload { encoding, bytes: payload, offset, lines }));
                }
                Some(word) => {
                    let problem = format!("expected format, comment, element, property or end_header, {}", found(Some(word)));
                    return Err(wrong(line, problem));
                }
            }
        }
    }
}

/// What follows `property`.
fn property<'a>(line: usize, mut words: impl Iterator<Item = &'a [u8]>) -> Result<Property, FormatError> {
    const TYPES: &str = "char, uchar, short, ushort, int, uint, float or double";
    let number =
        |word: Option<&[u8]>| word.and_then(Number::of).ok_or_else(|| wrong(line, format!("expected a type ({TYPES}), {}", found(word))));
    let first = words.next();
    let scalar = match first {
        Some(b"list") => {
            let count = number(words.next())?;
            if count.is_float() {
                return Err(wrong(line, "the count of a list is a floating-point number: expected a whole number, such as uchar"));
            }
            Scalar::List { count, item: number(words.next())? }
        }
        word => Scalar::Single(number(word)?),
    };
    let word = words.next().ok_or_else(|| wrong(line, "a property without a name"))?;
    Ok(Property { name: name(word), scalar })
}
