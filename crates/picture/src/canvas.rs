//! An RGB picture: pixels, text, pasting, PNG.

use beo_core::whole_file::write_whole;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle, iso_8859_1};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::primitives::{Circle, Line, PointsIter, Primitive, PrimitiveStyle, Rectangle};
use embedded_graphics::text::{Alignment, Baseline, Text, TextStyleBuilder};
use embedded_graphics::{Drawable, Pixel};
use std::path::{Path, PathBuf};

/// A colour, red, green and blue, with an opacity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Colour {
    /// Red, green, blue.
    pub rgb: [u8; 3],
    /// 0 is invisible, 1 is solid.
    pub opacity: f32,
}

impl Colour {
    /// Filled voxels that were observed.
    pub const KNOWN: Self = Self::rgb(66, 133, 190);
    /// Filled voxels that were predicted.
    pub const PREDICTED: Self = Self::rgb(240, 150, 70);
    /// Predicted without any certainty.
    pub const UNSURE: Self = Self::rgb(250, 236, 214);
    /// Unknown space: faint and translucent.
    pub const UNKNOWN: Self = Self { rgb: [150, 156, 166], opacity: 0.10 };
    /// The object's x axis, as in RViz.
    pub const X_AXIS: Self = Self::rgb(214, 48, 49);
    /// The object's y axis.
    pub const Y_AXIS: Self = Self::rgb(46, 150, 60);
    /// The object's z axis.
    pub const Z_AXIS: Self = Self::rgb(40, 90, 220);
    /// The edges of an object's box.
    pub const BOX: Self = Self::rgb(70, 130, 90);
    /// Observed voxels, where it is not what a picture is about.
    pub const SEEN_ASIDE: Self = Self::rgb(205, 210, 216);
    /// Pixels of a depth image without a reading.
    pub const NO_READING: Self = Self::rgb(176, 178, 182);
    /// Text, axes.
    pub const INK: Self = Self::rgb(50, 54, 62);
    /// Captions, the grid's axes.
    pub const QUIET: Self = Self::rgb(112, 118, 128);
    /// Grid lines, less important text.
    pub const FAINT: Self = Self::rgb(214, 218, 224);
    /// Paper.
    pub const PAPER: Self = Self::rgb(252, 252, 250);
    /// Distinct colours for series and categories.
    pub const SERIES: [Self; 10] = [
        Self::rgb(66, 133, 190),
        Self::rgb(240, 150, 70),
        Self::rgb(88, 165, 92),
        Self::rgb(206, 86, 96),
        Self::rgb(140, 108, 190),
        Self::rgb(150, 110, 90),
        Self::rgb(222, 130, 190),
        Self::rgb(130, 134, 142),
        Self::rgb(176, 178, 60),
        Self::rgb(60, 180, 190),
    ];

    /// A solid colour.
    pub const fn rgb(red: u8, green: u8, blue: u8) -> Self {
        Self { rgb: [red, green, blue], opacity: 1.0 }
    }

    /// The same colour with an opacity from 0 to 1.
    pub fn with_opacity(self, opacity: f32) -> Self {
        Self { opacity: opacity.clamp(0.0, 1.0), ..self }
    }

    /// The colour `t` of the way from `self` to `other`.
    pub fn mix(self, other: Self, t: f32) -> Self {
        let t = t.clamp(0.0, 1.0);
        let between = |a: f32, b: f32| a + (b - a) * t;
        let channel = |c: usize| between(self.rgb[c].into(), other.rgb[c].into()).round() as u8;
        Self { rgb: [channel(0), channel(1), channel(2)], opacity: between(self.opacity, other.opacity) }
    }

    /// For signed values such as a mode's weights: blue below zero, orange above, more solid the farther from zero; `value` from
    /// −1 to 1.
    pub fn signed(value: f32) -> Self {
        let colour = if value < 0.0 { Self::rgb(48, 105, 180) } else { Self::rgb(226, 96, 40) };
        colour.with_opacity(value.abs())
    }

    /// A predicted voxel or surface: the greater the standard deviation of its occupancy, the paler.
    pub fn predicted(deviation: f32) -> Self {
        Self::PREDICTED.mix(Self::UNSURE, deviation / MOST_UNSURE)
    }

    pub(super) fn shaded(self, light: f32) -> Self {
        Self { rgb: self.rgb.map(|c| (f32::from(c) * light).round().clamp(0.0, 255.0) as u8), ..self }
    }

    fn pixel(self) -> Rgb888 {
        Rgb888::new(self.rgb[0], self.rgb[1], self.rgb[2])
    }
}

/// The standard deviation of an occupancy from which on it is drawn as quite unsure: completions rarely have more.
pub const MOST_UNSURE: f32 = 0.3;

/// Size of text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TextSize {
    /// Tick labels, captions.
    Small,
    /// Axis labels.
    Medium,
    /// Titles.
    Large,
}

impl TextSize {
    fn font(self) -> &'static MonoFont<'static> {
        match self {
            Self::Small => &iso_8859_1::FONT_7X13,
            Self::Medium => &iso_8859_1::FONT_8X13,
            Self::Large => &iso_8859_1::FONT_9X18_BOLD,
        }
    }

    /// Height of a line in pixels.
    pub fn height(self) -> usize {
        self.font().character_size.height as usize
    }

    /// Width of a text in pixels.
    pub fn width(self, text: &str) -> usize {
        plain(text).chars().count() * self.font().character_size.width as usize
    }
}

/// Where text stands relative to its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Anchor {
    /// The point is the middle of its left end.
    Left,
    /// The point is its middle.
    Centre,
    /// The point is the middle of its right end.
    Right,
}

/// A picture could not be saved.
#[derive(Debug, thiserror::Error)]
pub enum SaveError {
    /// The file cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The picture cannot be encoded.
    #[error("cannot encode {}: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Error of the encoder.
        source: png::EncodingError,
    },
}

/// An RGB picture, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

impl Image {
    /// A picture of paper.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![Colour::PAPER.rgb; width * height] }
    }

    /// The pixels, three bytes each (red, green, blue), row by row from the top left.
    pub fn rgb(&self) -> &[u8] {
        self.pixels.as_flattened()
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The pixel at column `x`, row `y`.
    pub fn pixel(&self, x: usize, y: usize) -> [u8; 3] {
        self.pixels[y * self.width + x]
    }

    /// Lays a colour over a pixel; pixels outside of the picture are left out.
    pub fn blend(&mut self, x: usize, y: usize, colour: Colour) {
        if x < self.width && y < self.height {
            let below = &mut self.pixels[y * self.width + x];
            *below = Colour { rgb: *below, opacity: 1.0 }.mix(Colour { opacity: 1.0, ..colour }, colour.opacity).rgb;
        }
    }

    /// Sets a pixel.
    ///
    /// # Panics
    /// Outside the image.
    pub fn set(&mut self, x: usize, y: usize, rgb: [u8; 3]) {
        self.pixels[y * self.width + x] = rgb;
    }

    /// Copies `picture` in with its top left corner at (x, y); what does not fit is cut off.
    pub fn paste(&mut self, picture: &Image, x: usize, y: usize) {
        for row in 0..picture.height.min(self.height.saturating_sub(y)) {
            let width = picture.width.min(self.width.saturating_sub(x));
            let to = (y + row) * self.width + x;
            self.pixels[to..to + width].copy_from_slice(&picture.pixels[row * picture.width..][..width]);
        }
    }

    /// Writes one line of text; `x` and `y` are where its anchor stands.
    pub fn text(&mut self, text: &str, x: i32, y: i32, size: TextSize, anchor: Anchor, colour: Colour) {
        let alignment = match anchor {
            Anchor::Left => Alignment::Left,
            Anchor::Centre => Alignment::Center,
            Anchor::Right => Alignment::Right,
        };
        let style = TextStyleBuilder::new().alignment(alignment).baseline(Baseline::Middle).build();
        let text = plain(text);
        drawn(Text::with_text_style(&text, Point::new(x, y), MonoTextStyle::new(size.font(), colour.pixel()), style).draw(self));
    }

    /// Draws a line of some pixels' width.
    pub fn line(&mut self, from: (i32, i32), to: (i32, i32), width: u32, colour: Colour) {
        let style = PrimitiveStyle::with_stroke(colour.pixel(), width);
        drawn(Line::new(Point::new(from.0, from.1), Point::new(to.0, to.1)).into_styled(style).draw(self));
    }

    /// Fills a rectangle, given its top left corner; translucent colours let through what is below.
    pub fn rectangle(&mut self, x: i32, y: i32, width: u32, height: u32, colour: Colour) {
        let area = Rectangle::new(Point::new(x, y), Size::new(width, height));
        for p in area.intersection(&Rectangle::new(Point::zero(), self.size())).points() {
            self.blend(p.x as usize, p.y as usize, colour);
        }
    }

    /// Fills a disc around (x, y); translucent colours let through what is below.
    pub fn disc(&mut self, x: i32, y: i32, diameter: u32, colour: Colour) {
        for p in Circle::with_center(Point::new(x, y), diameter).into_styled(PrimitiveStyle::with_fill(Rgb888::BLACK)).pixels() {
            if let (Ok(x), Ok(y)) = (usize::try_from(p.0.x), usize::try_from(p.0.y)) {
                self.blend(x, y, colour);
            }
        }
    }

    /// The picture turned by 90° counter-clockwise.
    pub fn turned(&self) -> Self {
        let mut turned = Self::new(self.height, self.width);
        for y in 0..self.height {
            for x in 0..self.width {
                turned.set(y, self.width - 1 - x, self.pixel(x, y));
            }
        }
        turned
    }

    /// Writes the picture as PNG; the file appears under its name only when it is whole.
    pub fn save(&self, path: &Path) -> Result<(), SaveError> {
        let bytes =
            png_of(self.width as u32, self.height as u32, self.rgb()).map_err(|source| SaveError::Encode { path: path.into(), source })?;
        write_whole(path, &bytes).map_err(|source| SaveError::File { path: path.into(), source })
    }
}

/// Pixels as PNG: three bytes for each of width × height (red, green, blue), row by row from the top left.
///
/// # Errors
/// The encoder's, for a picture without pixels.
///
/// # Panics
/// If there are not as many pixels.
pub fn png_of(width: u32, height: u32, rgb: &[u8]) -> Result<Vec<u8>, png::EncodingError> {
    assert_eq!(Some(rgb.len() as u64), (3 * u64::from(width)).checked_mul(height.into()), "three bytes for each pixel");
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(rgb)?;
    writer.finish()?;
    Ok(bytes)
}

/// The fonts are ISO 8859-1: what they lack is replaced.
fn plain(text: &str) -> String {
    text.chars()
        .map(|c| match c {
            ' '..='~' | '\u{a0}'..='ÿ' => c,
            '–' | '—' | '−' => '-',
            'μ' => 'µ',
            _ => '?',
        })
        .collect()
}

/// Drawing onto a picture cannot fail.
fn drawn<T>(result: Result<T, std::convert::Infallible>) {
    match result {
        Ok(_) => {}
        Err(never) => match never {},
    }
}

impl OriginDimensions for Image {
    fn size(&self) -> Size {
        Size::new(self.width as u32, self.height as u32)
    }
}

impl DrawTarget for Image {
    type Color = Rgb888;
    type Error = std::convert::Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Self::Error> {
        for Pixel(p, colour) in pixels {
            if let (Ok(x), Ok(y)) = (usize::try_from(p.x), usize::try_from(p.y))
                && x < self.width
                && y < self.height
            {
                self.set(x, y, [colour.r(), colour.g(), colour.b()]);
            }
        }
        Ok(())
    }
}

/// Lays pictures out in rows with a caption below each, and a title above all; columns are as wide as their widest picture.
pub fn sheet(rows: &[Vec<(Image, String)>], title: &str) -> Image {
    let gap = 10;
    let caption = TextSize::Small.height() + 6;
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let cell_width = |(picture, text): &(Image, String)| picture.width.max(TextSize::Small.width(text));
    let widths: Vec<usize> = (0..columns).map(|c| rows.iter().filter_map(|row| row.get(c)).map(cell_width).max().unwrap_or(0)).collect();
    let caption_of = |row: &Vec<(Image, String)>| if row.iter().all(|(_, text)| text.is_empty()) { 0 } else { caption };
    let heights: Vec<usize> = rows.iter().map(|row| row.iter().map(|(p, _)| p.height).max().unwrap_or(0) + caption_of(row)).collect();
    let top = if title.is_empty() { gap } else { 2 * gap + TextSize::Large.height() };
    let width = (widths.iter().sum::<usize>() + gap * (columns + 1)).max(TextSize::Large.width(title) + 2 * gap);
    let mut out = Image::new(width, top + heights.iter().map(|h| h + gap).sum::<usize>());
    out.text(title, (width / 2) as i32, (gap + TextSize::Large.height() / 2) as i32, TextSize::Large, Anchor::Centre, Colour::INK);
    let mut y = top;
    for (row, height) in rows.iter().zip(&heights) {
        let mut x = gap;
        let below = caption_of(row);
        for ((picture, text), width) in row.iter().zip(&widths) {
            out.paste(picture, x + (width - picture.width) / 2, y);
            let line = (y + height - below / 2) as i32;
            out.text(text, (x + width / 2) as i32, line, TextSize::Small, Anchor::Centre, Colour::INK);
            x += width + gap;
        }
        y += height + gap;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_saved_picture_reads_back() {
        let mut image = Image::new(5, 3);
        image.blend(4, 2, Colour::rgb(10, 20, 30));
        image.blend(0, 0, Colour::rgb(0, 0, 0).with_opacity(0.5));
        image.blend(9, 9, Colour::INK);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        image.save(&path).unwrap();
        let mut reader = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap())).read_info().unwrap();
        let mut bytes = vec![0; 45];
        reader.next_frame(&mut bytes).unwrap();
        assert_eq!((&bytes[42..], &bytes[..3]), (&[10, 20, 30][..], &[126, 126, 125][..]));
        let error = image.save(&folder.path().join("none/a.png")).unwrap_err().to_string();
        assert!(error.starts_with("cannot write") && error.contains("a.png"), "{error}");
    }

    #[test]
    fn pasting_and_turning_keep_the_pixels() {
        let mut small = Image::new(2, 3);
        small.blend(1, 0, Colour::INK);
        let turned = small.turned();
        assert_eq!((turned.width(), turned.height(), turned.pixel(0, 0)), (3, 2, Colour::INK.rgb));
        let mut image = Image::new(4, 4);
        image.paste(&small, 2, 2);
        image.paste(&small, 9, 9);
        assert_eq!((image.pixel(3, 2), image.pixel(2, 2)), (Colour::INK.rgb, Colour::PAPER.rgb));
    }

    #[test]
    fn a_sheet_holds_every_picture_and_caption() {
        let picture = |side| (Image::new(side, side), "a caption".to_owned());
        let sheet = sheet(&[vec![picture(50), picture(100)], vec![picture(80)]], "Title");
        assert_eq!(sheet.width(), 10 + 80 + 10 + 100 + 10);
        assert_eq!(sheet.height(), 38 + (100 + 19 + 10) + (80 + 19 + 10));
    }
}
