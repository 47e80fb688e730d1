//! An image as the label of the object of each pixel, 0 for none.
//!
//! Whole numbers are labels, of a palette the indices are (as in PASCAL VOC). Colours are labels where they differ: black is none, grey
//! ones are the numbers they show, and every other colour is an object of its own, numbered in the order of appearance. Some values mark
//! pixels of which nobody decided what they belong to, as along the outlines in PASCAL VOC: they become 0, no object's.

use super::{Image, Raster, problem};
use beo_shapes::FormatError;
use std::collections::BTreeMap;

/// Labels that mark no object but pixels which nobody labelled.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum VoidLabels {
    /// The largest value of the image's type (255 or 65535), if it is not the only label in it; of signed types also −1.
    #[default]
    Customary,
    /// These, and no other.
    These(Vec<u16>),
}

/// The objects that colours stand for, the same in all images of a folder.
#[derive(Clone, Debug, Default)]
pub struct ColourLabels(BTreeMap<[u8; 3], u16>);

/// More colours are no instances: a photograph, or labels with softened edges.
const MOST_COLOURS: usize = 1000;
/// The colour of outlines where PASCAL VOC's label images were saved without their palette.
const VOC_VOID: [u8; 3] = [224, 224, 192];

impl Raster {
    /// The label of each pixel.
    ///
    /// # Errors
    /// Images that hold no labels: floating-point numbers, numbers out of range, JPEG, a thousand colours.
    pub fn into_labels(self, void: &VoidLabels, colours: &mut ColourLabels) -> Result<Image<u16>, FormatError> {
        let (mut labels, customary) = match self {
            Self::Bytes(image) | Self::Indexed { image, .. } => (image.map(u16::from), Some(255)),
            Self::Words(image) => (image, Some(u16::MAX)),
            Self::Integers { image, .. } => (of_integers(&image, void)?, None),
            Self::Colours(image) => of_colours(image, void, colours)?,
            Self::Floats(_) => return Err(wrong("floating-point numbers: labels are whole numbers from 0 to 65535")),
            Self::Lossy(_) => {
                return Err(wrong(
                    "JPEG changes the values of labels: save them as PNG; or name the file NAME_mask.jpg if it is the mask of one object",
                ));
            }
        };
        match (void, customary) {
            (VoidLabels::These(these), _) => labels.values.iter_mut().filter(|label| these.contains(label)).for_each(|label| *label = 0),
            (VoidLabels::Customary, Some(value)) if labels.values().iter().any(|label| *label != 0 && *label != value) => {
                labels.values.iter_mut().filter(|label| **label == value).for_each(|label| *label = 0);
            }
            _ => {}
        }
        Ok(labels)
    }
}

fn wrong(text: &str) -> FormatError {
    problem("labels", text.into())
}

fn of_integers(image: &Image<i64>, void: &VoidLabels) -> Result<Image<u16>, FormatError> {
    let [width, height] = image.size();
    let label = |(index, value): (usize, &i64)| match u16::try_from(*value) {
        Ok(label) => Ok(label),
        Err(_) if *value == -1 && *void == VoidLabels::Customary => Ok(0),
        Err(_) => {
            let (row, column) = (index / width as usize, index % width as usize);
            Err(wrong(&format!("row {row}, column {column} is {value}: labels are whole numbers from 0 to 65535")))
        }
    };
    let labels = image.values().iter().enumerate().map(label).collect::<Result<_, _>>()?;
    Ok(Image { width, height, values: labels })
}

/// Labels of colours, and the customary void label where they are greys.
fn of_colours(image: Image<[u8; 4]>, void: &VoidLabels, known: &mut ColourLabels) -> Result<(Image<u16>, Option<u16>), FormatError> {
    let is_cut_out = image.values().iter().any(|pixel| pixel[3] != image.values()[0][3]);
    let image = image.map(|[r, g, b, opacity]| if is_cut_out && opacity < 128 { [0; 3] } else { [r, g, b] });
    if image.values().iter().all(|[r, g, b]| r == g && g == b) {
        return Ok((image.map(|[grey, _, _]| grey.into()), Some(255)));
    }
    let mut labels = Vec::with_capacity(image.values().len());
    let mut last = ([0; 3], 0);
    for colour in image.values() {
        if *colour != last.0 {
            last = (*colour, known.label(*colour, void)?);
        }
        labels.push(last.1);
    }
    Ok((Image { width: image.width, height: image.height, values: labels }, None))
}

impl ColourLabels {
    fn label(&mut self, colour: [u8; 3], void: &VoidLabels) -> Result<u16, FormatError> {
        if colour == [0; 3] || (colour == VOC_VOID && *void == VoidLabels::Customary) {
            return Ok(0);
        }
        if let Some(label) = self.0.get(&colour) {
            return Ok(*label);
        }
        if self.0.len() == MOST_COLOURS {
            return Err(wrong(&format!(
                "more than {MOST_COLOURS} different colours: one for each object is expected, without soft edges; is it a photograph?"
            )));
        }
        let label = self.0.len() as u16 + 1;
        self.0.insert(colour, label);
        Ok(label)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row<T>(values: Vec<T>) -> Image<T> {
        Image::new(values.len() as u32, 1, values).unwrap()
    }

    fn labels(raster: Raster, void: &VoidLabels) -> Vec<u16> {
        raster.into_labels(void, &mut ColourLabels::default()).unwrap().into_values()
    }

    #[test]
    fn whole_numbers_and_indices_are_labels() {
        let customary = &VoidLabels::Customary;
        assert_eq!(labels(Raster::Bytes(row(vec![0, 7, 254])), customary), [0, 7, 254]);
        assert_eq!(labels(Raster::Words(row(vec![0, 255, 1500])), customary), [0, 255, 1500]);
        assert_eq!(labels(Raster::Indexed { image: row(vec![0, 2]), palette: vec![] }, customary), [0, 2]);
        assert_eq!(labels(Raster::Integers { image: row(vec![0, 65535]), largest: i64::MAX }, customary), [0, 65535]);
        let error = |raster: Raster| raster.into_labels(customary, &mut ColourLabels::default()).unwrap_err().to_string();
        assert!(error(Raster::Integers { image: row(vec![0, 65536]), largest: i64::MAX }).contains("row 0, column 1 is 65536"));
        assert!(error(Raster::Floats(row(vec![1.0]))).contains("whole numbers"));
        assert!(error(Raster::Lossy(row(vec![1]))).contains("NAME_mask.jpg"));
    }

    #[test]
    fn the_largest_value_is_void_unless_it_is_the_only_label_or_others_are_named() {
        let bytes = || Raster::Bytes(row(vec![0, 1, 255, 9]));
        assert_eq!(labels(bytes(), &VoidLabels::Customary), [0, 1, 0, 9]);
        assert_eq!(labels(bytes(), &VoidLabels::These(vec![9, 1])), [0, 0, 255, 0]);
        assert_eq!(labels(bytes(), &VoidLabels::These(vec![])), [0, 1, 255, 9]);
        assert_eq!(labels(Raster::Bytes(row(vec![0, 255])), &VoidLabels::Customary), [0, 255]);
        assert_eq!(labels(Raster::Words(row(vec![0, 255, 65535])), &VoidLabels::Customary), [0, 255, 0]);
        assert_eq!(labels(Raster::Integers { image: row(vec![-1, 4]), largest: 127 }, &VoidLabels::Customary), [0, 4]);
    }

    #[test]
    fn colours_are_objects_that_keep_their_number_and_greys_are_numbers() {
        let mut known = ColourLabels::default();
        let mut of =
            |pixels: Vec<[u8; 4]>| Raster::Colours(row(pixels)).into_labels(&VoidLabels::Customary, &mut known).unwrap().into_values();
        let [black, red, blue, void] = [[0, 0, 0, 255], [255, 0, 0, 255], [0, 0, 90, 255], [224, 224, 192, 255]];
        assert_eq!(of(vec![black, blue, red, blue, void]), [0, 1, 2, 1, 0]);
        assert_eq!(of(vec![red, blue, [0, 9, 0, 255]]), [2, 1, 3]);
        assert_eq!(of(vec![black, [3, 3, 3, 255], [255, 255, 255, 255]]), [0, 3, 0]);
        assert_eq!(of(vec![red, [255, 0, 0, 0]]), [2, 0]);
        let many = (0..2000).map(|i| [i as u8, (i >> 8) as u8, 1, 255]).collect();
        let error = Raster::Colours(row(many)).into_labels(&VoidLabels::Customary, &mut ColourLabels::default()).unwrap_err().to_string();
        assert!(error.contains("photograph"), "{error}");
    }
}
