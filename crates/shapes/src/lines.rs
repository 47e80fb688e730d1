//! Lines and numbers of text files, as every text format here reads them.
//!
//! A byte order mark of UTF-8 is passed over. Lines end with a line feed, a carriage return, or both. Text of 16-bit units is refused by name.

use super::FormatError;
use beo_core::text::printable;

/// The byte order mark of UTF-8.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// The bytes after a byte order mark, if there is one.
pub(super) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes)
}

/// The lines of a text file, counted from 1, without their ends.
#[derive(Debug, Clone)]
pub(super) struct Lines<'a> {
    rest: Option<&'a [u8]>,
    number: usize,
}

impl<'a> Lines<'a> {
    /// Of a file of a text format.
    pub fn of(bytes: &'a [u8], format: &'static str) -> Result<Self, FormatError> {
        if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
            let problem = "the text is UTF-16 (it starts with that byte order mark): save it as UTF-8 or ASCII".into();
            return Err(FormatError::File { format, problem });
        }
        Ok(Self { rest: Some(without_mark(bytes)), number: 0 })
    }

    /// The rest that has not been read, from the start of a line.
    pub fn rest(&self) -> &'a [u8] {
        self.rest.unwrap_or_default()
    }

    /// Number of the line read last.
    pub fn number(&self) -> usize {
        self.number
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (usize, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let rest = self.rest.take()?;
        self.number += 1;
        let line = match rest.iter().position(|b| matches!(b, b'\n' | b'\r')) {
            Some(end) => {
                let width = if rest[end..].starts_with(b"\r\n") { 2 } else { 1 };
                self.rest = Some(&rest[end + width..]);
                &rest[..end]
            }
            None => rest,
        };
        Some((self.number, line))
    }
}

/// The words of a line.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|b| b.is_ascii_whitespace()).filter(|word| !word.is_empty())
}

/// A finite number.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse::<f64>().ok().filter(|value| value.is_finite())
}

/// A whole number.
pub(super) fn whole<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// A word as a message repeats it: short, on one line, and with what is known to be wrong with it.
pub(super) fn found(word: Option<&[u8]>) -> String {
    let Some(word) = word else { return "found nothing more".into() };
    let text: String = printable(&String::from_utf8_lossy(word)).chars().take(30).collect();
    let hint = match number(word) {
        _ if word.contains(&b',') => " (numbers are written with a point and parted by spaces)",
        None if text.parse::<f64>().is_ok() => " (not a finite number)",
        _ => "",
    };
    format!("found `{text}`{hint}")
}

/// An index as a message repeats it: numbers with a fraction or an exponent are said to be no indices.
pub(super) fn found_index(word: Option<&[u8]>) -> String {
    match word {
        Some(word) if number(word).is_some() && whole::<i64>(word).is_none() => {
            format!("{}, which is not a whole number: write indices without a point or an exponent", found(Some(word)))
        }
        word => found(word),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_end_ends_one_line_and_a_mark_is_passed_over() {
        let lines = |text: &'static [u8]| Lines::of(text, "X").unwrap().map(|(n, line)| (n, line.to_vec())).collect::<Vec<_>>();
        let expected = vec![(1, b"a".to_vec()), (2, b"".to_vec()), (3, b"b".to_vec()), (4, b"".to_vec())];
        for text in [&b"a\n\nb\n"[..], b"a\r\n\r\nb\r\n", b"a\r\rb\r", b"\xef\xbb\xbfa\n\r\nb\r"] {
            assert_eq!(lines(text), expected, "{text:?}");
        }
        let message = Lines::of(b"\xff\xfev\0", "OBJ").unwrap_err().to_string();
        assert_eq!(message, "OBJ: the text is UTF-16 (it starts with that byte order mark): save it as UTF-8 or ASCII");
    }

    #[test]
    fn words_are_repeated_with_what_is_wrong_with_them() {
        assert_eq!(found(Some(b"1,5")), "found `1,5` (numbers are written with a point and parted by spaces)");
        assert_eq!(found(Some(b"nan")), "found `nan` (not a finite number)");
        assert_eq!(found(Some(b"x\x1b")), "found `x `");
        assert_eq!(found(None), "found nothing more");
        assert!(found_index(Some(b"1.0")).contains("not a whole number"));
        assert_eq!(found_index(Some(b"7")), "found `7`");
    }
}
