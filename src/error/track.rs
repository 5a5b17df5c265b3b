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
    /// The header has no true value of a parameter.
    #[error(
        "the header has no true {parameter}; give fits of mocks, which have true values of all parameters"
    )]
    NoTruth {
        /// The first parameter without one.
        parameter: &'static str,
    },
    /// There is no table.
    #[error("the file has no table; give columns phi and r with r_err, and n where known")]
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
        "column `{column}` is missing (found {}); name the columns phi, r and r_err, and n where known", found.join(", ")
    )]
    MissingColumn {
        /// The missing column.
        column: &'static str,
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
    /// The names of the columns are not separated as they must be.
    #[error(
        "the names of the columns are not separated in {names:?}; separate names and values by commas in CSV, and as the header says in ECSV"
    )]
    Delimiter {
        /// What stands between two delimiters.
        names: String,
    },
    /// The name of a column has its unit in it.
    #[error(
        "column `{column}` has its unit in its name; name it `{name}`, and give units in the header: in CSV as `# units: phi deg, r arcsec`, \
         in ECSV with the column"
    )]
    UnitInName {
        /// The column.
        column: String,
        /// Its name without the unit.
        name: &'static str,
    },
    /// A column is not known, and what it says would be ignored.
    #[error(
        "column `{column}` is not known{}; {}: the known columns are {}",
        nearest.map(|name| format!(" (the nearest name is `{name}`)")).unwrap_or_default(),
        if nearest.is_some() { "rename or remove it" } else { "remove it" },
        known.join(", ")
    )]
    UnknownColumn {
        /// The column.
        column: String,
        /// The known name that it may be meant for.
        nearest: Option<&'static str>,
        /// All that are known.
        known: &'static [&'static str],
    },
    /// Two columns have the same name.
    #[error("column `{column}` is there twice; remove one of the two")]
    RepeatedColumn {
        /// The column.
        column: String,
    },
    /// Both columns of angles are there.
    #[error("the columns `phi` and `PA` are both there; keep one of them")]
    PhiAndPa,
    /// Position angles without that of the progenitor.
    #[error(
        "column `PA` needs the progenitor's position angle; give `progenitor_pa` in degrees, east of north, in the header"
    )]
    NoProgenitorPa,
    /// Position angles of a track that covers a turn or more.
    #[error(
        "column `PA` covers a whole turn or more, so that it does not tell how often the stream is around the host; give `phi`, \
         counted from the progenitor and increasing past 180 deg, in its place"
    )]
    PaOverATurn,
    /// Position angles that do not increase.
    #[error(
        "column `PA` is {pa_deg} deg after {previous_deg} deg; give the rows in order along the stream, each bin once and with position angles that \
         increase, over north as 350, 0, 10, or give `phi` in its place"
    )]
    PaNotIncreasing {
        /// The position angle.
        pa_deg: f64,
        /// The position angle of the row before.
        previous_deg: f64,
    },
    /// Position angles of rows that may be sorted by them, and not along the stream.
    #[error(
        "column `PA` has its widest gap within the rows, from {from_deg} to {to_deg} deg, and not between the last row and the first; give the \
         rows in order along the stream, not sorted by `PA`, or give `phi` in its place"
    )]
    PaGap {
        /// The position angle before the gap.
        from_deg: f64,
        /// The position angle after it.
        to_deg: f64,
    },
    /// The progenitor's position angle in the header of a track without a column of position angles.
    #[error(
        "`progenitor_pa` in the header belongs to a column `PA`, and there is none; remove it, or give `PA` in place of `phi`"
    )]
    ProgenitorPaWithoutPa,
    /// The radii have no errors.
    #[error(
        "the radii have no errors; add a column `r_err`, or `r_err_lo` and `r_err_hi`, or state an error for all bins in the header, such \
         as `assume_error: 2%`"
    )]
    NoErrors,
    /// The radii have errors, and others are to be assumed.
    #[error("the radii have errors, and an assumed error is given too; remove one of the two")]
    ErrorsAndAssumption,
    /// The columns of errors do not go together.
    #[error(
        "the columns of errors do not go together; give either `r_err`, or both `r_err_lo` and `r_err_hi`"
    )]
    ErrorColumns,
    /// A value has no error, or an error no value.
    #[error(
        "`{given}` is given without `{missing}`; give both in a bin, or leave both empty where nothing is measured"
    )]
    HalfMeasured {
        /// The column that is given.
        given: &'static str,
        /// The column that is missing or empty.
        missing: &'static str,
    },
    /// A quantity is measured in no bin.
    #[error(
        "column `{column}` is empty; give a value in at least one bin, or leave the column out"
    )]
    NeverMeasured {
        /// The column.
        column: &'static str,
    },
    /// A row without a radius, which is that of a single star, has not what a star has.
    #[error(
        "a row without `r` is a single star: {what}; give it phi (or PA), `v` and `v_err` alone, or the row a radius"
    )]
    BadStar {
        /// What it lacks or has in vain.
        what: String,
    },
    /// A star is in no bin of the track.
    #[error(
        "the star at phi = {phi_deg} deg is in no bin that has a radius; leave it out, or give the bin its radius"
    )]
    StarOutside {
        /// Its angle.
        phi_deg: f64,
    },
    /// An entry of the header is nearly one that is read.
    #[error(
        "`{key}` in the header is not read; write it as `{nearest}: value`, or use another word"
    )]
    HeaderKey {
        /// Its key or first word.
        key: String,
        /// The key that may be meant.
        nearest: String,
    },
    /// An entry of the header is where it is not read.
    #[error(
        "`{key}` is not read here; move it above the names of the columns, and in ECSV into the `meta` of the header"
    )]
    HeaderPlace {
        /// Its key or first word.
        key: String,
    },
    /// The header says something twice.
    #[error("the header gives {what} twice; remove one of the two")]
    RepeatedKey {
        /// What it says.
        what: String,
    },
    /// An entry of the header cannot be understood.
    #[error("`{key}` in the header is {text}; give {expected}")]
    HeaderValue {
        /// The key.
        key: &'static str,
        /// What the header gives.
        text: String,
        /// What it must be.
        expected: &'static str,
    },
    /// The header has a distance, and the radii have no unit.
    #[error(
        "the header has a `distance`, but column `r` has no unit, so that it is not clear whether `r` is an angle; give the unit, \
         arcsec or kpc: in ECSV with the column, in CSV as `# units: r arcsec`"
    )]
    DistanceWithoutUnit,
    /// Lengths in arcsec need a distance.
    #[error(
        "column `{column}` is in arcsec and the header has no `distance`; add `distance` in Mpc, a number above zero, to the header, or \
         give {column} in kpc"
    )]
    NoDistance {
        /// The column.
        column: &'static str,
    },
    /// The header's distance is not a positive number of Mpc.
    #[error(
        "the header's `distance` is {text}; add `distance` in Mpc, a number above zero, to the header, or give r in kpc"
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
    /// There are too many rows.
    #[error("the table has more than {max} rows; give wider bins, or fewer single stars")]
    TooManyRows {
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
}
