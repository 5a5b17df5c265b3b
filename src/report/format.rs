//! The formats of figures: SVG as they are drawn, and PDF with the fonts of this machine in it.

use crate::error::{Error, Result};
use std::str::FromStr;
use svg2pdf::usvg::{Options, Tree};
use svg2pdf::{ConversionOptions, PageOptions};

/// A format of figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FigureFormat {
    /// SVG.
    Svg,
    /// PDF.
    Pdf,
}

impl FigureFormat {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Svg, Self::Pdf];

    /// Its name, which is the extension of its files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Svg => "svg",
            Self::Pdf => "pdf",
        }
    }
}

impl FromStr for FigureFormat {
    type Err = Error;

    /// # Errors
    /// [`Error::Setting`] for anything but `svg` and `pdf`.
    fn from_str(text: &str) -> Result<Self> {
        let known = Self::ALL.into_iter().find(|format| format.name() == text);
        known.ok_or_else(|| unusable(text, "give svg or pdf"))
    }
}

fn unusable(value: &str, remedy: &str) -> Error {
    Error::Setting {
        key: "format".to_owned(),
        value: value.to_owned(),
        remedy: remedy.to_owned(),
    }
}

/// Fonts in place of Helvetica and Arial, where these are not there; the first of them that is there.
const FONTS: [&str; 5] = [
    "Helvetica",
    "Arial",
    "Liberation Sans",
    "DejaVu Sans",
    "Noto Sans",
];

/// A writer of figures in some formats.
#[derive(Debug)]
pub struct FigureWriter {
    formats: Vec<FigureFormat>,
    /// With the fonts of this machine, if one of the formats needs them.
    options: Options<'static>,
}

impl FigureWriter {
    /// Of these formats.
    ///
    /// # Errors
    /// [`Error::Setting`] for PDF on a machine without fonts.
    pub fn new(formats: &[FigureFormat]) -> Result<Self> {
        let mut options = Options::default();
        if formats.contains(&FigureFormat::Pdf) {
            let fonts = options.fontdb_mut();
            fonts.load_system_fonts();
            let families = fonts.faces().flat_map(|face| &face.families);
            let families: Vec<String> = families.map(|(family, _)| family.clone()).collect();
            let there = |font: &&str| families.iter().any(|family| family == font);
            let known = FONTS.iter().copied().find(there);
            let Some(font) = known.or(families.first().map(String::as_str)) else {
                return Err(unusable(
                    "pdf",
                    "this machine has no fonts: install some, such as DejaVu, or write SVG",
                ));
            };
            fonts.set_sans_serif_family(font);
        }
        Ok(Self {
            formats: formats.to_vec(),
            options,
        })
    }

    /// A drawing in each of the formats.
    ///
    /// # Errors
    /// [`Error::Setting`] if a drawing cannot be converted.
    pub fn files(&self, svg: &str) -> Result<Vec<(FigureFormat, Vec<u8>)>> {
        let formats = self.formats.iter();
        formats
            .map(|format| Ok((*format, self.file(svg, *format)?)))
            .collect()
    }

    fn file(&self, svg: &str, format: FigureFormat) -> Result<Vec<u8>> {
        let failed = |cause: String| unusable("pdf", &format!("{cause}; write SVG instead"));
        match format {
            FigureFormat::Svg => Ok(svg.as_bytes().to_vec()),
            FigureFormat::Pdf => {
                let tree = Tree::from_str(svg, &self.options).map_err(|e| failed(e.to_string()))?;
                let (conversion, page) = (ConversionOptions::default(), PageOptions::default());
                svg2pdf::to_pdf(&tree, conversion, page).map_err(|e| failed(e.to_string()))
            }
        }
    }
}
