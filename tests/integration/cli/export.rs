//! Draws as tables: both formats have the numbers of the run.

use super::{json, oblate, refused, small_fit};
use fitskit::{BinCellValue, FitsFile, HduData};
use oblate::inference::DERIVED;
use oblate::params::{QRange, Shape};
use oblate::posterior::{DrawTable, Summary, SummaryContext, TableFormat, zarr};
use oblate::scalar::Vec3;
use std::collections::BTreeSet;
use std::path::Path;

#[test]
fn a_run_is_exported_as_ecsv_and_as_fits() {
    let (folder, config, track) = small_fit();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (run, ecsv, fits) = (path("run"), path("draws.ecsv"), path("draws.fits"));
    let fit = [
        "fit",
        &track,
        "--config",
        &config,
        "--coarse-particles",
        "0",
    ];
    let fit = [&fit[..], &["--out", &run, "--allow-unconverged", "-q"]].concat();
    assert_eq!(oblate(&fit, "").status.code(), Some(0));
    let export = |out: &str, more: &[&str]| {
        oblate(
            &[&["export", &run, "--out", out, "--json"], more].concat(),
            "",
        )
    };
    let output = export(&ecsv, &[]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let said = json(&output.stdout);
    assert_eq!(export(&fits, &[]).status.code(), Some(0));
    refused(&export(&fits, &[]), &["exists already", "--force"]);
    assert_eq!(export(&fits, &["--force"]).status.code(), Some(0));
    refused(&export(&path("draws.txt"), &[]), &[".ecsv or .fits"]);

    // ECSV: a header, the names, a row for each draw.
    let text = std::fs::read_to_string(&ecsv).expect("the table");
    assert!(text.starts_with("# %ECSV 1.0\n# ---\n"));
    assert!(text.contains("# - {name: log10_m_halo, unit: dex(solMass), datatype: float64}\n"));
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().expect("names").split(',').collect();
    assert_eq!(said["columns"], serde_json::json!(names));
    let rows: Vec<Vec<f64>> = lines
        .map(|line| {
            line.split(',')
                .map(|x| x.parse().expect("a number"))
                .collect()
        })
        .collect();
    assert_eq!(said["draws"], rows.len());

    // FITS: the same to the bit.
    let file = FitsFile::from_file(&fits).expect("FITS");
    let table = file.find_extension("POSTERIOR").expect("the extension");
    let HduData::BinTable(table) = &table.data else {
        panic!("no table")
    };
    let found: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(found, names);
    assert_eq!(table.nrows, rows.len());
    for (i, row) in rows.iter().enumerate() {
        for (k, value) in row.iter().enumerate() {
            let cell = table.get_cell(i, k).expect("a cell");
            let BinCellValue::F64(cell) = cell else {
                panic!("{cell:?}")
            };
            assert_eq!(cell[0].to_bits(), value.to_bits(), "{i} {k}");
        }
    }

    // They are draws of the run, each column under its own name.
    let stored = zarr::read(&Path::new(&run).join("posterior.zarr")).expect("the draws");
    let draws = &stored.draws;
    let expected: Vec<&str> = ["log10_m_halo", "dir_z", "log10_m_prog"]
        .into_iter()
        .chain(DERIVED.map(|(name, _)| name))
        .chain(["ln_likelihood"])
        .collect();
    assert_eq!(names, expected);
    let of_draw = |i: usize| {
        let derived = &draws.derived[i * draws.derived_dim..][..draws.derived_dim];
        [draws.theta_row(i), derived, &[draws.ln_likelihood[i]]].concat()
    };
    let bits = |row: &[f64]| row.iter().map(|x| x.to_bits()).collect::<Vec<u64>>();
    let own: BTreeSet<Vec<u64>> = (0..draws.len()).map(|i| bits(&of_draw(i))).collect();
    assert!(rows.iter().all(|row| own.contains(&bits(row))));
    // The names are those of the values: the shape follows from its vector, of which two components are fixed.
    let place = |name: &str| names.iter().position(|own| *own == name).expect("a column");
    for row in &rows {
        let dir = Vec3::new(0.1, 0.2, row[place("dir_z")]);
        let Shape { q, axis } = QRange::default().shape(dir);
        for (name, value) in [
            ("q", q),
            ("axis_x", axis.x),
            ("axis_y", axis.y),
            ("axis_z", axis.z),
        ] {
            assert!((row[place(name)] - value).abs() < 1e-12, "{name}");
        }
        assert!((11.0..14.0).contains(&row[place("log10_m_halo")]));
        assert!((7.0..9.0).contains(&row[place("log10_m_prog")]));
    }
}

#[test]
fn numbers_that_are_not_finite_have_no_card_in_fits_and_are_those_of_yaml_in_ecsv() {
    let run = crate::runs::nested(200, 5);
    let mut summary = Summary::new(&run, &SummaryContext::default());
    let tables = |summary: &Summary| {
        let table = DrawTable::new(&run, summary);
        let text = table.bytes(TableFormat::Ecsv).expect("ECSV");
        let file = table.bytes(TableFormat::Fits).expect("FITS");
        let file = FitsFile::from_bytes(&file).expect("FITS");
        let header = &file.find_extension("POSTERIOR").expect("it").header;
        let cards = ["LNZ", "LNZ_ERR", "ESS"].map(|key| header.get_float(key).is_some());
        assert!(header.get_int("SEED").is_some());
        (String::from_utf8(text).expect("text"), cards)
    };
    assert_eq!(tables(&summary).1, [true; 3]);
    summary.ln_z.value = f64::NEG_INFINITY;
    summary.ln_z.error = f64::INFINITY;
    summary.ess = f64::NAN;
    let (text, cards) = tables(&summary);
    assert_eq!(cards, [false; 3]);
    assert!(
        text.contains("#   ln_z: -.inf\n#   ln_z_error: .inf\n#   ess: .nan\n"),
        "{text}"
    );
}

#[test]
fn the_metadata_of_all_arrays_is_in_the_root_in_the_order_of_the_parameters() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("posterior.zarr");
    let run = crate::runs::nested(500, 5);
    zarr::write(&path, &run, zarr::Extras::default()).expect("it is written");
    let text = std::fs::read_to_string(path.join("zarr.json")).expect("the root");
    let root: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let all = &root["consolidated_metadata"]["metadata"];
    let entries = zarr::entries(&path).expect("its files");
    let mut count = 0;
    for file in entries.files.iter().filter(|f| f.ends_with("zarr.json")) {
        let node = file.parent().expect("a folder").display().to_string();
        if !node.is_empty() {
            let own = std::fs::read(path.join(file)).expect("metadata");
            assert_eq!(json(&own), all[&node], "{node}");
            count += 1;
        }
    }
    assert_eq!(all.as_object().expect("an object").len(), count);
    let places: Vec<usize> = run
        .names
        .iter()
        .map(|name| {
            text.find(&format!("\"posterior/{name}\""))
                .expect("its metadata")
        })
        .collect();
    assert!(
        places.windows(2).all(|pair| pair[0] < pair[1]),
        "{places:?}"
    );
}
