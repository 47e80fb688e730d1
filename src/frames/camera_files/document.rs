//! A small YAML or JSON document as a tree of text. JSON is YAML but for tabs, which it has only between its parts.
//!
//! The document is walked event by event; aliases, which can make a small file huge, are refused.

use super::error::{wrong, wrong_line};
use beo_shapes::FormatError;
use saphyr_parser::{Event, Parser};

/// Longest file that is read; they have about two thousand bytes, of all streams of a sensor about thirty thousand.
pub(super) const LONGEST: usize = 1 << 17;
/// Deepest nesting.
const DEEPEST: usize = 16;

/// Most keys of a mapping.
const MOST_KEYS: usize = 1000;

/// A part of the document.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Node {
    Scalar(String),
    List(Vec<Node>),
    /// Keys that are no text are empty.
    Map(Vec<(String, Node)>),
}

/// A list or mapping that the walk is in.
enum Open {
    List(Vec<Node>),
    /// The complete entries, and the key whose value comes next.
    Map(Vec<(String, Node)>, Option<String>),
}

impl Node {
    /// The first document of a file.
    pub(super) fn parse(text: &str) -> Result<Self, FormatError> {
        let json = text.trim_start().starts_with(['{', '[']).then(|| text.replace('\t', " "));
        let mut open: Vec<Open> = Vec::new();
        for event in Parser::new_from_str(json.as_deref().unwrap_or(text)) {
            let (event, span) = event.map_err(|error| wrong_line(error.marker().line(), error.info()))?;
            let complete = match event {
                Event::Scalar(value, ..) => Self::Scalar(value.into_owned()),
                Event::MappingStart(..) | Event::SequenceStart(..) if open.len() == DEEPEST => {
                    return Err(wrong_line(span.start.line(), "nested too deeply"));
                }
                Event::MappingStart(..) => {
                    open.push(Open::Map(Vec::new(), None));
                    continue;
                }
                Event::SequenceStart(..) => {
                    open.push(Open::List(Vec::new()));
                    continue;
                }
                Event::MappingEnd | Event::SequenceEnd => match open.pop() {
                    Some(Open::List(items)) => Self::List(items),
                    Some(Open::Map(entries, _)) => Self::Map(entries),
                    None => continue,
                },
                Event::Alias(_) => return Err(wrong_line(span.start.line(), "aliases are not supported: write the value itself")),
                Event::DocumentEnd => break,
                _ => continue,
            };
            match open.last_mut() {
                Some(Open::List(items)) => items.push(complete),
                Some(Open::Map(entries, key @ Some(_))) => entries.push((key.take().unwrap_or_default(), complete)),
                Some(Open::Map(entries, key)) => {
                    let text = if let Self::Scalar(text) = complete { text } else { String::new() };
                    if entries.len() == MOST_KEYS {
                        return Err(wrong_line(span.start.line(), "a mapping of too many keys"));
                    }
                    if entries.iter().any(|(known, _)| *known == text && !text.is_empty()) {
                        return Err(wrong_line(span.start.line(), &format!("a second {text:.40}: which one holds?")));
                    }
                    *key = Some(text);
                }
                None => return Ok(complete),
            }
        }
        Ok(Self::Map(Vec::new()))
    }

    /// The entries of a mapping; none of anything else.
    pub(super) fn entries(&self) -> &[(String, Self)] {
        if let Self::Map(entries) = self { entries } else { &[] }
    }

    /// The value of a key in any of its spellings, upper case or lower.
    pub(super) fn get(&self, spellings: &[&str]) -> Result<Option<&Self>, FormatError> {
        let mut found = self.entries().iter().filter(|(key, _)| spellings.iter().any(|name| name.eq_ignore_ascii_case(key)));
        match (found.next(), found.next()) {
            (Some((one, _)), Some((other, _))) => Err(wrong(format!("both {one} and {other}: which one holds?"))),
            (first, _) => Ok(first.map(|(_, value)| value)),
        }
    }

    /// Whether there is such a key.
    pub(super) fn has(&self, spellings: &[&str]) -> bool {
        self.entries().iter().any(|(key, _)| spellings.iter().any(|name| name.eq_ignore_ascii_case(key)))
    }

    /// Text of a key; `None` where it is absent, empty or null.
    pub(super) fn text(&self, spellings: &[&str]) -> Result<Option<&str>, FormatError> {
        match self.get(spellings)? {
            None => Ok(None),
            Some(Self::Scalar(text)) => Ok(Some(&text[..]).filter(|text| !["", "~", "null"].contains(text))),
            Some(_) => Err(wrong(format!("{} is not one value", spellings[0]))),
        }
    }

    /// A number of pixels.
    pub(super) fn pixels(&self, spellings: &[&str]) -> Result<Option<u32>, FormatError> {
        let number = |text: &str| text.parse().map_err(|_| wrong(format!("{} is `{text:.40}`: expected a number of pixels", spellings[0])));
        self.text(spellings)?.map(number).transpose()
    }

    /// A number.
    pub(super) fn number(&self, spellings: &[&str]) -> Result<Option<f64>, FormatError> {
        self.text(spellings)?.map(|text| parse_number(spellings[0], text)).transpose()
    }

    /// Numbers of a key: a list, lists in a list, or a mapping with `data`, as OpenCV and ROS write matrices.
    pub(super) fn numbers(&self, spellings: &[&str]) -> Result<Option<Vec<f64>>, FormatError> {
        let Some(mut value) = self.get(spellings)? else { return Ok(None) };
        if let Self::Map(_) = value {
            value = value.get(&["data"])?.ok_or_else(|| wrong(format!("{} has no data", spellings[0])))?;
        }
        let mut numbers = Vec::new();
        value.collect(spellings[0], &mut numbers)?;
        Ok(Some(numbers))
    }

    fn collect(&self, name: &str, numbers: &mut Vec<f64>) -> Result<(), FormatError> {
        match self {
            Self::Scalar(text) if ["", "~", "null"].contains(&&text[..]) => {}
            Self::Scalar(text) => numbers.push(parse_number(name, text)?),
            Self::List(items) => items.iter().try_for_each(|item| item.collect(name, numbers))?,
            Self::Map(_) => return Err(wrong(format!("{name} holds what is not a number"))),
        }
        Ok(())
    }
}

fn parse_number(name: &str, text: &str) -> Result<f64, FormatError> {
    text.parse().map_err(|_| wrong(format!("{name}: `{text:.40}` is not a number")))
}
