//! Faults of a track, in a file or in memory.

/// A fault of a track; the message ends with what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrackFault {
    /// The header of an ECSV file cannot be understood.
    #[error(
        "the header cannot be read ({message}); write the table with astropy (`format=\"ascii.ecsv\"`), or use plain CSV"
    )]
    Header {
        /// What is wrong with it.
        message: String,
    },
    /// There is no table.
    #[error("the file has no table; give columns phi and r, with r_err and n where known")]
    NoTable,
    /// A line is not a row.
    #[error(
        "not a row of a table ({message}); give one row per bin, its values separated as the header says"
    )]
    BadRow {
        /// The parser's message.
        message: String,
    },
    /// A row has more or fewer values than there are columns.
    #[error(
        "{values} values where the header names {columns} columns; give every row one value per column, separated as the header says"
    )]
    RowLength {
        /// Number of values.
        values: usize,
        /// Number of columns.
        columns: usize,
    },
    /// A column is missing.
    #[error(
        "column `{column}` is missing (found {}); name the columns phi, r and, where known, r_err and n", found.join(", ")
    )]
    MissingColumn {
        /// The missing column.
        column: String,
        /// The columns of the file.
        found: Vec<String>,
    },
    /// A value is not a number.
    #[error("column `{column}` is {text:?}, not a number; give a number, or drop the row")]
    NotANumber {
        /// The column.
        column: String,
        /// The value.
        text: String,
    },
    /// A column has an unknown unit.
    #[error("column `{column}` is in `{unit}`; give it in {known}")]
    UnknownUnit {
        /// The column.
        column: String,
        /// Its unit.
        unit: String,
        /// The units that are known.
        known: &'static str,
    },
    /// The header's bin width is not a number.
    #[error("`bin_width` is {text}; give the width of a bin in degrees as a plain number")]
    BinWidthNotANumber {
        /// What the header gives.
        text: String,
    },
    /// Radii in arcsec need a distance.
    #[error(
        "column `r` is in arcsec and the header has no `distance`; add `distance` in Mpc, a number above zero, to the header's meta, or \
         give r in kpc"
    )]
    NoDistance,
    /// The header's distance is not a positive number of Mpc.
    #[error(
        "the header's `distance` is {text}; add `distance` in Mpc, a number above zero, to the header's meta, or give r in kpc"
    )]
    BadDistance {
        /// What the header gives.
        text: String,
    },
    /// Columns have different lengths.
    #[error("columns of different lengths; give every column one value per bin")]
    ColumnLengths,
    /// There are too few bins.
    #[error(
        "a track of {bins} bins; give at least {min} bins: a shorter arc does not constrain a halo"
    )]
    TooFewBins {
        /// Number of bins.
        bins: usize,
        /// The minimum.
        min: usize,
    },
    /// There are too many bins.
    #[error("a track of {bins} bins; give at most {max} bins, which must be wider then")]
    TooManyBins {
        /// Number of bins.
        bins: usize,
        /// The maximum.
        max: usize,
    },
    /// A value is out of its range.
    #[error(
        "column `{column}` is {value:?} {unit}; give a value from {lo:?} to {hi:?} {unit}, or drop the row"
    )]
    OutOfRange {
        /// The column.
        column: &'static str,
        /// The value.
        value: f64,
        /// The smallest that is allowed.
        lo: f64,
        /// The largest that is allowed.
        hi: f64,
        /// The unit of all three.
        unit: &'static str,
    },
    /// A value is NaN or infinite.
    #[error("column `{column}` is {value}; give a finite number, or drop the row")]
    NotFinite {
        /// The column.
        column: &'static str,
        /// The value.
        value: f64,
    },
    /// A radius or its error is not positive.
    #[error("column `{column}` is {value}; give a value above zero, or drop the row")]
    NotPositive {
        /// The column.
        column: &'static str,
        /// The value.
        value: f64,
    },
    /// A number of stars is negative, not a number or larger than that of any galaxy.
    #[error(
        "column `n` is {value:?}; give the number of stars in the bin, 0 to 1e12, or leave the column out"
    )]
    BadCount {
        /// The value.
        value: f64,
    },
    /// Angles do not increase.
    #[error(
        "column `phi` is {phi_deg} deg after {previous_deg} deg; sort the rows by phi and give each bin once: phi increases past 180 deg \
         where a stream wraps"
    )]
    NotIncreasing {
        /// The angle.
        phi_deg: f64,
        /// The angle of the row before.
        previous_deg: f64,
    },
    /// The bin width is out of its range.
    #[error("a bin width of {width_deg:?} deg; give `bin_width` in degrees, from {lo:?} to {hi:?}")]
    BinWidth {
        /// The width.
        width_deg: f64,
        /// The smallest that is allowed.
        lo: f64,
        /// The largest that is allowed.
        hi: f64,
    },
    /// Bins are not equally wide.
    #[error(
        "column `phi` steps by {step_deg} deg where bins are {width_deg} deg wide; give equally wide bins (whole bins may be missing), \
         or set `bin_width` in the header"
    )]
    UnequalBins {
        /// The step between two centres.
        step_deg: f64,
        /// The bin width.
        width_deg: f64,
    },
    /// Bin edges are not multiples of the bin width.
    #[error(
        "column `phi` is {phi_deg} deg, not the centre of a bin whose edges are multiples of {width_deg} deg; bin the stars with the \
         progenitor at phi = 0 on an edge, so that centres are (k + 1/2) bin widths"
    )]
    OffGrid {
        /// The centre.
        phi_deg: f64,
        /// The bin width.
        width_deg: f64,
    },
}
