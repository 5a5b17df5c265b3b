//! Names, fields and places of the parameters agree, in code and in files.

use oblate::params::{NAMES, PARAMETERS, StreamParams, index_of};

fn counting() -> StreamParams<f64> {
    StreamParams::from_array(std::array::from_fn(|i| i as f64))
}

#[test]
fn names_fields_and_indices_agree() {
    let json = serde_json::to_value(counting()).unwrap();
    for (i, name) in NAMES.iter().enumerate() {
        assert_eq!(json[name].as_f64(), Some(i as f64), "{name}");
        assert_eq!(index_of(name), Some(i));
        assert_eq!(PARAMETERS[i].name, *name);
    }
    assert_eq!(index_of("mass"), None);
}

#[test]
fn json_comes_back_to_the_same_bits() {
    let params = counting().map(|x| (x + 0.1) / 3.0);
    let text = serde_json::to_string(&params).unwrap();
    assert_eq!(
        serde_json::from_str::<StreamParams<f64>>(&text).unwrap(),
        params
    );
}

#[test]
fn a_missing_or_an_unknown_key_is_an_error_that_names_it() {
    let mut json = serde_json::to_value(counting()).unwrap();
    let table = json.as_object_mut().unwrap();
    table.insert("spin".to_owned(), 1.0.into());
    let error = serde_json::from_value::<StreamParams<f64>>(json.clone()).unwrap_err();
    assert!(error.to_string().contains("spin"), "{error}");
    let table = json.as_object_mut().unwrap();
    table.remove("spin");
    table.remove("age_gyr");
    let error = serde_json::from_value::<StreamParams<f64>>(json).unwrap_err();
    assert!(error.to_string().contains("age_gyr"), "{error}");
}
