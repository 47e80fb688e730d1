//! The entries of a PLY file, one at a time: as text or as bytes.

use super::error::{FORMAT, error};
use super::header::{Element, Encoding, Number, Payload, Scalar};
use crate::FormatError;
use crate::lines::{Lines, found, found_index, number, whole, words};
use crate::polygon::Place;

/// The values of one entry, as double-precision numbers, which hold every type exactly.
#[derive(Debug, Default)]
pub(super) struct Values {
    values: Vec<f64>,
    /// Where each property ends.
    ends: Vec<usize>,
}

impl Values {
    /// The value of a property that is one number.
    pub fn single(&self, property: usize) -> f64 {
        self.list(property)[0]
    }

    /// The values of a property.
    pub fn list(&self, property: usize) -> &[f64] {
        let start = property.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.values[start..self.ends[property]]
    }

    fn clear(&mut self) {
        self.values.clear();
        self.ends.clear();
    }
}

/// Where the entries are read from.
#[derive(Debug)]
enum Source<'a> {
    Text(Lines<'a>),
    Bytes { rest: &'a [u8], offset: usize, is_big: bool },
}

/// The entries that have not been read.
#[derive(Debug)]
pub(super) struct Entries<'a> {
    source: Source<'a>,
    values: Values,
}

impl<'a> Entries<'a> {
    /// Those of `payload`.
    pub fn new(payload: Payload<'a>) -> Self {
        let Payload { encoding, bytes: rest, offset, lines } = payload;
        let source = match encoding {
            Encoding::Text => Source::Text(lines),
            Encoding::LittleEndian => Source::Bytes { rest, offset, is_big: false },
            Encoding::BigEndian => Source::Bytes { rest, offset, is_big: true },
        };
        Self { source, values: Values::default() }
    }

    /// Fails if the bytes left cannot hold the entries of an element.
    pub fn check_room(&self, element: &Element) -> Result<(), FormatError> {
        let (left, least) = match &self.source {
            // A digit and a line end, of which the last may be missing.
            Source::Text(lines) => (lines.rest().len() + 1, 2 * element.properties.len()),
            Source::Bytes { rest, .. } => {
                let size = |scalar: Scalar| match scalar {
                    Scalar::Single(number) => number.size(),
                    Scalar::List { count, .. } => count.size(),
                };
                (rest.len(), element.properties.iter().map(|property| size(property.scalar)).sum())
            }
        };
        if element.count > 0 && element.properties.is_empty() {
            return Err(error(format!("element `{}` has no properties", element.name)));
        }
        if element.count.saturating_mul(least) > left {
            let problem = format!(
                "{} entries of `{}` do not fit into the {left} bytes left: the file is incomplete, or its header wrong",
                element.count, element.name
            );
            return Err(error(problem));
        }
        Ok(())
    }

    /// The next entry, and where it stands.
    pub fn next(&mut self, element: &Element) -> Result<(Place, &Values), FormatError> {
        self.values.clear();
        let place = match &mut self.source {
            Source::Text(lines) => {
                let next = lines.find(|(_, text)| !text.trim_ascii().is_empty());
                let Some((line, text)) = next else {
                    let problem = format!("the file ends before its entries of `{}` do: it is incomplete", element.name);
                    return Err(FormatError::Line { format: FORMAT, line: lines.number(), problem });
                };
                read_text(text, element, &mut self.values).map_err(|problem| FormatError::Line { format: FORMAT, line, problem })?;
                Place::Line(line)
            }
            Source::Bytes { rest, offset, is_big } => {
                let place = *offset;
                let before = rest.len();
                read_bytes(rest, *is_big, element, &mut self.values).map_err(|problem| {
                    let byte = place + (before - rest.len());
                    FormatError::Byte { format: FORMAT, byte, problem }
                })?;
                *offset += before - rest.len();
                Place::Byte(place)
            }
        };
        Ok((place, &self.values))
    }
}

fn read_text(text: &[u8], element: &Element, values: &mut Values) -> Result<(), String> {
    let mut words = words(text);
    for property in &element.properties {
        let name = &property.name;
        match property.scalar {
            Scalar::Single(_) => {
                let word = words.next();
                // What the type cannot be is no reason to refuse what is not used: NaN normals are common.
                let value = word.and_then(|word| number(word).or_else(|| std::str::from_utf8(word).ok()?.parse().ok()));
                let value = value.ok_or_else(|| {
                    let of = element.properties.len();
                    format!("expected {of} values of `{}`, among them `{name}`, {}", element.name, found(word))
                })?;
                values.values.push(value);
            }
            Scalar::List { item, .. } => {
                let word = words.next();
                let count = word.and_then(whole::<usize>);
                let count = count.ok_or_else(|| format!("expected the count of the list `{name}`, {}", found_index(word)))?;
                if count > text.len() {
                    return Err(format!("a list of {count} entries of `{name}`, which the line does not hold"));
                }
                for _ in 0..count {
                    let word = words.next();
                    let value = match item.is_float() {
                        true => word.and_then(number),
                        false => word.and_then(whole::<i64>).map(|value| value as f64),
                    };
                    let value = value.ok_or_else(|| match item.is_float() {
                        true => format!("expected {count} numbers of `{name}`, {}", found(word)),
                        false => format!("expected {count} whole numbers of `{name}`, {}", found_index(word)),
                    })?;
                    values.values.push(value);
                }
            }
        }
        values.ends.push(values.values.len());
    }
    match words.next() {
        None => Ok(()),
        word => Err(format!("more values than `{}` has: {}; expected one entry a line", element.name, found(word))),
    }
}

fn read_bytes(rest: &mut &[u8], is_big: bool, element: &Element, values: &mut Values) -> Result<(), String> {
    let end = || format!("the file ends before its entries of `{}` do: it is incomplete", element.name);
    for property in &element.properties {
        match property.scalar {
            Scalar::Single(number) => values.values.push(take(rest, number, is_big).ok_or_else(end)?),
            Scalar::List { count, item } => {
                let count = take(rest, count, is_big).ok_or_else(end)?;
                if count < 0.0 {
                    return Err(format!("the list `{}` has {count} entries: expected none or more", property.name));
                }
                if count * item.size() as f64 > rest.len() as f64 {
                    let left = rest.len();
                    return Err(format!("a list of {count} entries of `{}` does not fit into the {left} bytes left", property.name));
                }
                for _ in 0..count as usize {
                    values.values.push(take(rest, item, is_big).ok_or_else(end)?);
                }
            }
        }
        values.ends.push(values.values.len());
    }
    Ok(())
}

/// The next number.
fn take(rest: &mut &[u8], number: Number, is_big: bool) -> Option<f64> {
    let (bytes, after) = rest.split_at_checked(number.size())?;
    *rest = after;
    let mut raw = [0; 8];
    raw[..bytes.len()].copy_from_slice(bytes);
    if is_big {
        raw[..bytes.len()].reverse();
    }
    let [a, b, c, d, ..] = raw;
    Some(match number {
        Number::I8 => f64::from(a as i8),
        Number::U8 => f64::from(a),
        Number::I16 => f64::from(i16::from_le_bytes([a, b])),
        Number::U16 => f64::from(u16::from_le_bytes([a, b])),
        Number::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
        Number::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
        Number::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
        Number::F64 => f64::from_le_bytes(raw),
    })
}
