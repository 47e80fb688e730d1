//! NumPy's `.npy` files: the header, and arrays of plain numbers, in C and Fortran order and both byte orders.
//!
//! The format: `\x93NUMPY`, a version, the length of a header, the header (the literal of a Python dictionary with `descr`, `fortran_order` and
//! `shape`), the numbers (`numpy.lib.format`).

use std::io::Write;

/// Longest header read; that of a plain array takes 128 bytes.
pub const LONGEST_HEADER: usize = 4096;
/// Most axes of an array.
const MOST_AXES: usize = 8;

/// A kind of numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NpyKind {
    /// True or false, a byte each.
    Bool,
    /// Whole numbers.
    Signed,
    /// Whole numbers from 0.
    Unsigned,
    /// Floating-point numbers.
    Float,
    /// Complex numbers, text, times, records.
    Other,
}

/// The header of an `.npy` file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NpyHeader {
    /// Kind of the numbers.
    pub kind: NpyKind,
    /// Bytes of one number.
    pub width: usize,
    /// Whether the highest byte of a number comes first.
    pub is_big_endian: bool,
    /// Whether the first axis runs fastest.
    pub is_fortran: bool,
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// Where the numbers start in the file.
    pub start: usize,
    descr: String,
}

impl NpyHeader {
    /// Reads the header at the start of `bytes`, which may end after it.
    ///
    /// # Errors
    /// In words: no `.npy` file, a version or header that is unknown, incomplete, or not that of a plain array of up to eight axes.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let (start, length) = match bytes {
            [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _, a, b, ..] => (10, u16::from_le_bytes([*a, *b]) as usize),
            [0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, _, a, b, c, d, ..] => (12, u32::from_le_bytes([*a, *b, *c, *d]) as usize),
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => return Err("unknown version or a truncated header".into()),
            _ => return Err("does not start as an .npy file does: write it with numpy.save".into()),
        };
        let header = (length <= LONGEST_HEADER).then(|| bytes.get(start..start + length)).flatten();
        let header = header.ok_or_else(|| format!("a header of {length} bytes: truncated, or not that of a plain array"))?;
        let text = std::str::from_utf8(header).map_err(|_| "the header is not text")?;
        let entries = entries(text).ok_or("the header is not that of a plain array (a record or a damaged file)")?;
        let (kind, width, is_big_endian) = number_type(entries.descr).ok_or_else(|| format!("unknown type `{}`", short(entries.descr)))?;
        Ok(Self {
            kind,
            width,
            is_big_endian,
            is_fortran: entries.is_fortran,
            shape: entries.shape,
            start: start + length,
            descr: entries.descr.into(),
        })
    }

    /// The type as NumPy calls it, such as `float32`.
    pub fn type_name(&self) -> String {
        let bits = 8 * self.width;
        match self.kind {
            NpyKind::Bool => "bool".into(),
            NpyKind::Signed => format!("int{bits}"),
            NpyKind::Unsigned => format!("uint{bits}"),
            NpyKind::Float => format!("float{bits}"),
            NpyKind::Other => format!("`{}`", short(&self.descr)),
        }
    }

    /// The lengths of the axes as Python writes them.
    pub fn shape_name(&self) -> String {
        let lengths: Vec<String> = self.shape.iter().map(usize::to_string).collect();
        match &lengths[..] {
            [one] => format!("({one},)"),
            all => format!("({})", all.join(", ")),
        }
    }

    /// Number of numbers, unless that does not fit.
    pub fn count(&self) -> Option<usize> {
        self.shape.iter().try_fold(1_usize, |count, length| count.checked_mul(*length))
    }

    /// The numbers of the file `bytes`, which this is the header of, in C order (the last axis runs fastest).
    ///
    /// # Errors
    /// In words: another type than `T`, or another number of bytes than the shape takes.
    pub fn numbers<T: NpyNumber>(&self, bytes: &[u8]) -> Result<Vec<T>, String> {
        if (self.kind, self.width) != (T::KIND, T::WIDTH) {
            return Err(format!("the array is of type {}", self.type_name()));
        }
        let data = bytes.get(self.start..).unwrap_or_default();
        let count = self.count().filter(|count| count.checked_mul(T::WIDTH) == Some(data.len()));
        let count = count.ok_or_else(|| {
            let shape = self.shape_name();
            format!(
                "{} bytes of data for an array of shape {shape} and {} bytes each: the file is incomplete or damaged",
                data.len(),
                T::WIDTH
            )
        })?;
        let number = |n: usize| T::from_bytes(&data[n * T::WIDTH..(n + 1) * T::WIDTH], self.is_big_endian);
        Ok(match self.is_fortran {
            false => (0..count).map(number).collect(),
            true => (0..count).map(|n| number(self.fortran_place(n))).collect(),
        })
    }

    /// Where the number stands in Fortran order whose place in C order is `place`.
    fn fortran_place(&self, mut place: usize) -> usize {
        let (mut found, mut stride) = (0, self.count().unwrap_or(0));
        for &length in self.shape.iter().rev() {
            stride /= length;
            found += place % length * stride;
            place /= length;
        }
        found
    }
}

/// Writes the header of an array in C order; the numbers are to follow, the lowest byte of each first.
///
/// # Errors
/// Those of `out`.
pub fn write_npy_header<T: NpyNumber>(out: &mut impl Write, shape: &[usize]) -> std::io::Result<()> {
    let letter = match T::KIND {
        NpyKind::Bool => 'b',
        NpyKind::Signed => 'i',
        NpyKind::Unsigned => 'u',
        NpyKind::Float | NpyKind::Other => 'f',
    };
    let order = if T::WIDTH == 1 { '|' } else { '<' };
    let lengths: String = shape.iter().map(|length| format!("{length}, ")).collect();
    let lengths = if shape.len() == 1 { lengths.trim_end() } else { lengths.trim_end_matches(", ") };
    let mut header = format!("{{'descr': '{order}{letter}{}', 'fortran_order': False, 'shape': ({lengths}), }}", T::WIDTH);
    // The numbers start at a multiple of 64 bytes; a line end comes before them.
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    out.write_all(b"\x93NUMPY\x01\x00")?;
    out.write_all(&(header.len() as u16).to_le_bytes())?;
    out.write_all(header.as_bytes())
}

/// Numbers that arrays hold.
pub trait NpyNumber: Copy {
    /// Their kind.
    const KIND: NpyKind;
    /// Bytes of one.
    const WIDTH: usize;

    /// From so many bytes.
    fn from_bytes(bytes: &[u8], is_big_endian: bool) -> Self;
}

macro_rules! numbers {
    ($($number:ty: $kind:ident),*) => {$(
        impl NpyNumber for $number {
            const KIND: NpyKind = NpyKind::$kind;
            const WIDTH: usize = size_of::<$number>();

            fn from_bytes(bytes: &[u8], is_big_endian: bool) -> Self {
                let mut raw = [0; size_of::<$number>()];
                raw.copy_from_slice(bytes);
                if is_big_endian { Self::from_be_bytes(raw) } else { Self::from_le_bytes(raw) }
            }
        }
    )*};
}

numbers!(u8: Unsigned, u16: Unsigned, u32: Unsigned, u64: Unsigned, i8: Signed, i16: Signed, i32: Signed, i64: Signed, f32: Float, f64: Float);

impl NpyNumber for bool {
    const KIND: NpyKind = NpyKind::Bool;
    const WIDTH: usize = 1;

    fn from_bytes(bytes: &[u8], _: bool) -> Self {
        bytes != [0]
    }
}

fn short(text: &str) -> String {
    beo_core::text::printable(text).chars().take(40).collect()
}

/// Kind, width and byte order of a type such as `<f4`.
fn number_type(descr: &str) -> Option<(NpyKind, usize, bool)> {
    let (order, rest) = match descr.strip_prefix(['<', '>', '|', '=']) {
        Some(rest) => (descr.as_bytes()[0], rest),
        None => (b'=', descr),
    };
    let letter = rest.chars().next().filter(char::is_ascii)?;
    let width = &rest[1..];
    let width: usize = width.chars().take_while(char::is_ascii_digit).collect::<String>().parse().ok().filter(|width| *width <= 1 << 20)?;
    let kind = match (letter, width) {
        ('b', 1) => NpyKind::Bool,
        ('i', 1 | 2 | 4 | 8) => NpyKind::Signed,
        ('u', 1 | 2 | 4 | 8) => NpyKind::Unsigned,
        ('f', 2 | 4 | 8 | 16) => NpyKind::Float,
        _ => NpyKind::Other,
    };
    Some((kind, width, order == b'>'))
}

/// Content of a header.
struct Entries<'a> {
    descr: &'a str,
    is_fortran: bool,
    shape: Vec<usize>,
}

/// The entries of the dictionary, in whatever order; none if one is missing, twice there, unknown, or no plain value.
fn entries(text: &str) -> Option<Entries<'_>> {
    let mut rest = text.trim().strip_prefix('{')?.strip_suffix('}')?.trim();
    let (mut descr, mut is_fortran, mut shape) = (None, None, None);
    while !rest.is_empty() {
        let (key, after) = quoted(rest)?;
        rest = after.trim_start().strip_prefix(':')?.trim_start();
        match key {
            "descr" if descr.is_none() => {
                let (value, after) = quoted(rest)?;
                (descr, rest) = (Some(value), after);
            }
            "fortran_order" if is_fortran.is_none() => {
                let (value, after) =
                    [("True", true), ("False", false)].iter().find_map(|(word, value)| Some((*value, rest.strip_prefix(word)?)))?;
                (is_fortran, rest) = (Some(value), after);
            }
            "shape" if shape.is_none() => {
                let (value, after) = rest.strip_prefix('(')?.split_once(')')?;
                (shape, rest) = (Some(lengths(value)?), after);
            }
            _ => return None,
        }
        rest = rest.trim_start();
        rest = match rest.strip_prefix(',') {
            Some(after) => after.trim_start(),
            None if rest.is_empty() => rest,
            None => return None,
        };
    }
    Some(Entries { descr: descr?, is_fortran: is_fortran?, shape: shape? })
}

/// The text between the quotes at the start, and what comes after.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| *c == '\'' || *c == '"')?;
    text[1..].split_once(quote)
}

/// The lengths between the parentheses of a shape; `L` after a number is Python 2's.
fn lengths(text: &str) -> Option<Vec<usize>> {
    let words: Vec<&str> = text.split(',').map(|n| n.trim().trim_end_matches('L')).collect();
    let words = words.strip_suffix(&[""]).unwrap_or(&words);
    let length = |word: &&str| word.bytes().all(|b| b.is_ascii_digit()).then(|| word.parse::<usize>().ok()).flatten();
    (words.len() <= MOST_AXES).then(|| words.iter().map(length).collect()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file as `numpy.save` of NumPy 2.4.6 wrote it: the header is filled with blanks to 128 bytes.
    pub(in crate::npy) fn numpy_file(dictionary: &str, data: &str) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
        bytes.extend(dictionary.as_bytes());
        bytes.resize(127, b' ');
        bytes.push(b'\n');
        bytes.extend((0..data.len() / 2).map(|n| u8::from_str_radix(&data[2 * n..2 * n + 2], 16).unwrap()));
        bytes
    }

    fn numbers<T: NpyNumber>(dictionary: &str, data: &str) -> Vec<T> {
        let bytes = numpy_file(dictionary, data);
        NpyHeader::parse(&bytes).unwrap().numbers(&bytes).unwrap()
    }

    #[test]
    fn arrays_that_numpy_wrote_are_read_in_c_order() {
        let whole = [1, 2, 3, -4, 5, 60];
        let c = "{'descr': '<i4', 'fortran_order': False, 'shape': (2, 3), }";
        assert_eq!(numbers::<i32>(c, "010000000200000003000000fcffffff050000003c000000"), whole);
        let fortran = "{'descr': '<i4', 'fortran_order': True, 'shape': (2, 3), }";
        assert_eq!(numbers::<i32>(fortran, "01000000fcffffff0200000005000000030000003c000000"), whole);
        let big = "{'descr': '>i2', 'fortran_order': False, 'shape': (2, 3), }";
        assert_eq!(numbers::<i16>(big, "000100020003fffc0005003c"), whole.map(|n| n as i16));
        let quarters = whole.map(|n| f64::from(n) / 4.0);
        let doubles = "{'descr': '>f8', 'fortran_order': False, 'shape': (2, 3), }";
        assert_eq!(
            numbers::<f64>(doubles, "3fd00000000000003fe00000000000003fe8000000000000bff00000000000003ff4000000000000402e000000000000"),
            quarters
        );
        let singles = "{'descr': '<f4', 'fortran_order': True, 'shape': (2, 3), }";
        assert_eq!(numbers::<f32>(singles, "0000803e000080bf0000003f0000a03f0000403f00007041"), quarters.map(|n| n as f32));
        assert_eq!(numbers::<u8>("{'descr': '|u1', 'fortran_order': False, 'shape': (3,), }", "070809"), [7, 8, 9]);
        let truths = numbers::<bool>("{'descr': '|b1', 'fortran_order': False, 'shape': (2, 2, 2), }", "0001000001000001");
        assert_eq!(truths, [0, 1, 2, 3, 4, 5, 6, 7].map(|n| n % 3 == 1));
    }

    #[test]
    fn a_header_is_written_as_numpy_writes_it() {
        let mut bytes = Vec::new();
        write_npy_header::<i32>(&mut bytes, &[2, 3]).unwrap();
        assert_eq!(bytes, numpy_file("{'descr': '<i4', 'fortran_order': False, 'shape': (2, 3), }", ""));
        bytes.clear();
        write_npy_header::<u8>(&mut bytes, &[3]).unwrap();
        assert_eq!(bytes, numpy_file("{'descr': '|u1', 'fortran_order': False, 'shape': (3,), }", ""));
    }

    #[test]
    fn other_headers_are_refused() {
        let refused = |dictionary: &str| NpyHeader::parse(&numpy_file(dictionary, "")).unwrap_err();
        for wrong in [
            "{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (3,), }",
            "{'descr': '<f4', 'fortran_order': False, }",
            "{'descr': '<f4', 'fortran_order': 0, 'shape': (3,), }",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3,), 'shape': (3,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-3,), }",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999999,), }",
            "{'descr': '<f4' 'fortran_order': False, 'shape': (3,)}",
        ] {
            assert!(refused(wrong).contains("not that of a plain array"), "{wrong}");
        }
        assert!(refused("{'descr': 'object', 'fortran_order': False, 'shape': (3,), }").contains("unknown type `object`"));
        let text = NpyHeader::parse(&numpy_file("{'descr': '<U7', 'fortran_order': False, 'shape': (3,), }", "")).unwrap();
        assert_eq!((text.kind, text.type_name().as_str(), text.shape_name().as_str()), (NpyKind::Other, "`<U7`", "(3,)"));
        let huge =
            NpyHeader::parse(&numpy_file("{'descr': '<f4', 'fortran_order': False, 'shape': (4294967296, 4294967296, 4294967296), }", ""))
                .unwrap();
        assert_eq!(huge.count(), None);
        assert!(huge.numbers::<f32>(&[0; 200]).unwrap_err().contains("incomplete or damaged"));
    }
}
