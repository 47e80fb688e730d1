//! NumPy arrays of rows × columns as images: floating-point metres, whole numbers of units, labels or masks.

use super::{Image, MOST_PIXELS, Raster, problem};
use beo_shapes::FormatError;
use beo_shapes::npy::{NpyHeader, NpyKind, NpyNumber};

const FORMAT: &str = "npy";
const EXPECTED: &str = "two axes, rows and columns";

fn error(text: impl ToString) -> FormatError {
    problem(FORMAT, text.to_string())
}

/// Reads a two-dimensional array of bool, whole numbers of whatever width, float32 or float64.
///
/// # Errors
/// [`FormatError`]: another type or shape, data that do not fit.
pub fn parse_npy_image(bytes: &[u8]) -> Result<Raster, FormatError> {
    let header = NpyHeader::parse(bytes).map_err(error)?;
    let &[rows, columns] = &header.shape[..] else {
        return Err(error(format!("the array has shape {}: expected {EXPECTED}", header.shape_name())));
    };
    let pixels = rows.saturating_mul(columns);
    if pixels == 0 || pixels as u64 > MOST_PIXELS as u64 {
        return Err(error(format!("{columns} × {rows} pixels: expected 1 to {MOST_PIXELS}")));
    }
    let (length, width) = (bytes.len() - header.start, header.width);
    let is_known =
        matches!((header.kind, width), (NpyKind::Bool, 1) | (NpyKind::Unsigned | NpyKind::Signed, 1 | 2 | 4 | 8) | (NpyKind::Float, 4 | 8));
    if !is_known {
        return Err(error(format!("type {}: expected float32, float64, whole numbers or bool", header.type_name())));
    }
    if length as u64 != (pixels as u64).saturating_mul(width as u64) {
        return Err(error(format!("{length} bytes of data for {columns} × {rows} pixels of {width} bytes each")));
    }
    let array = Array { header: &header, bytes, size: [columns as u32, rows as u32] };
    match (header.kind, width) {
        (NpyKind::Bool, _) => Ok(Raster::Bytes(array.read(|value: bool| Some(u8::from(value)))?)),
        (NpyKind::Unsigned, 1) => Ok(Raster::Bytes(array.read(Some)?)),
        (NpyKind::Unsigned, 2) => Ok(Raster::Words(array.read(Some)?)),
        (NpyKind::Unsigned, 4) => array.integers(u32::MAX.into(), |value: u32| Some(value.into())),
        // No image needs more than 63 bits; the largest value of 64 stands for nothing, as i64's does.
        (NpyKind::Unsigned, _) => {
            array.integers(i64::MAX, |value: u64| if value == u64::MAX { Some(i64::MAX) } else { value.try_into().ok() })
        }
        (NpyKind::Signed, 1) => array.integers(i8::MAX.into(), |value: i8| Some(value.into())),
        (NpyKind::Signed, 2) => array.integers(i16::MAX.into(), |value: i16| Some(value.into())),
        (NpyKind::Signed, 4) => array.integers(i32::MAX.into(), |value: i32| Some(value.into())),
        (NpyKind::Signed, _) => array.integers(i64::MAX, Some),
        (NpyKind::Float, 4) => Ok(Raster::Floats(array.read(Some)?)),
        _ => Ok(Raster::Floats(array.read(|value: f64| Some(value as f32))?)),
    }
}

struct Array<'a> {
    header: &'a NpyHeader,
    bytes: &'a [u8],
    /// Columns, rows.
    size: [u32; 2],
}

impl Array<'_> {
    fn integers<T: NpyNumber>(&self, largest: i64, convert: impl Fn(T) -> Option<i64>) -> Result<Raster, FormatError> {
        Ok(Raster::Integers { image: self.read(convert)?, largest })
    }

    /// Row by row, whatever the order in the file.
    fn read<T: NpyNumber, U: Copy>(&self, convert: impl Fn(T) -> Option<U>) -> Result<Image<U>, FormatError> {
        let [width, height] = self.size;
        let values = self.header.numbers::<T>(self.bytes).map_err(error)?;
        let mut stored = Vec::with_capacity(values.len());
        for (index, value) in values.into_iter().enumerate() {
            let outside = || {
                let (row, column) = (index / width as usize, index % width as usize);
                error(format!("the value of row {row}, column {column} is out of range"))
            };
            stored.push(convert(value).ok_or_else(outside)?);
        }
        Image::new(width, height, stored).ok_or_else(|| error("fewer values than its header says"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn file(descr: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn every_type_and_order_gives_the_same_image() {
        let values = [0_u8, 1, 2, 3, 4, 5];
        let words = Raster::Words(Image::new(3, 2, vec![0, 1, 2, 3, 4, 5]).unwrap());
        let bytes = Raster::Bytes(Image::new(3, 2, values.to_vec()).unwrap());
        let floats = Raster::Floats(Image::new(3, 2, vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0]).unwrap());
        let integers = |largest| Raster::Integers { image: Image::new(3, 2, vec![0, 1, 2, 3, 4, 5]).unwrap(), largest };
        for (descr, data, expected) in [
            ("|u1", values.to_vec(), &bytes),
            ("|i1", values.to_vec(), &integers(127)),
            ("<u2", values.iter().flat_map(|v| u16::from(*v).to_le_bytes()).collect(), &words),
            (">u2", values.iter().flat_map(|v| u16::from(*v).to_be_bytes()).collect(), &words),
            ("<i2", values.iter().flat_map(|v| i16::from(*v).to_le_bytes()).collect(), &integers(32_767)),
            ("<i4", values.iter().flat_map(|v| i32::from(*v).to_le_bytes()).collect(), &integers(i32::MAX.into())),
            ("<u4", values.iter().flat_map(|v| u32::from(*v).to_le_bytes()).collect(), &integers(u32::MAX.into())),
            ("<i8", values.iter().flat_map(|v| i64::from(*v).to_le_bytes()).collect(), &integers(i64::MAX)),
            ("<u8", values.iter().flat_map(|v| u64::from(*v).to_le_bytes()).collect(), &integers(i64::MAX)),
            ("<f4", values.iter().flat_map(|v| f32::from(*v).to_le_bytes()).collect(), &floats),
            (">f4", values.iter().flat_map(|v| f32::from(*v).to_be_bytes()).collect(), &floats),
            ("<f8", values.iter().flat_map(|v| f64::from(*v).to_le_bytes()).collect(), &floats),
        ] {
            assert_eq!(parse_npy_image(&file(descr, "False", "(2, 3)", &data)).as_ref(), Ok(expected), "{descr}");
        }
        // numpy.asfortranarray([[0, 1, 2], [3, 4, 5]]) is stored column by column.
        assert_eq!(parse_npy_image(&file("|u1", "True", "(2, 3)", &[0, 3, 1, 4, 2, 5])).unwrap(), bytes);
        let mask = parse_npy_image(&file("|b1", "False", "(1, 2)", &[0, 1])).unwrap();
        assert_eq!(mask, Raster::Bytes(Image::new(2, 1, vec![0, 1]).unwrap()));
    }

    #[test]
    fn what_is_no_image_is_refused_with_the_reason() {
        let message = |bytes: &[u8]| parse_npy_image(bytes).unwrap_err().to_string();
        assert!(message(&file("<f4", "False", "(2, 3, 1)", &[0; 24])).contains("two axes, rows and columns"));
        assert!(message(&file("<f4", "False", "(2, 3)", &[0; 20])).contains("20 bytes of data for 3 × 2 pixels of 4"));
        assert!(message(&file("<f4", "False", "(999999, 999999)", &[])).contains("expected 1 to"));
        assert!(message(&file("<f4", "False", "(0, 3)", &[])).contains("expected 1 to"));
        assert!(message(&file("<f2", "False", "(2, 3)", &[0; 12])).contains("expected float32"));
        assert!(message(&file("<c8", "False", "(1, 1)", &[0; 8])).contains("expected float32"));
        let beyond = [[0; 16], [255, 255, 255, 255, 255, 255, 255, 254, 0, 0, 0, 0, 0, 0, 0, 0]].concat();
        assert!(message(&file("<u8", "True", "(2, 2)", &beyond)).contains("row 0, column 1 is out of range"));
        assert!(message(b"\x93NUMPY").contains("truncated"));
    }

    proptest! {
        #[test]
        fn damaged_files_do_not_panic(at in 0..90_usize, byte in any::<u8>(), descr in "[|<>=]?[a-zA-Z][0-9]{0,3}") {
            let mut bytes = file(&descr, "False", "(3, 4)", &[1; 48]);
            bytes[at] = byte;
            let _ = parse_npy_image(&bytes);
            let _ = parse_npy_image(&bytes[..at]);
        }
    }
}
