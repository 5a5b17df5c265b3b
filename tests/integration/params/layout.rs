//! Names, fields and places of the parameters agree, in code and in files.

use oblate::params::{NAMES, PARAMETERS, REQUIRED, StreamParams, index_of};
use oblate_samplers::Marginal;

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

#[test]
fn the_parameters_of_every_stream_come_first() {
    for (i, parameter) in PARAMETERS.iter().enumerate() {
        assert_eq!(parameter.absent.is_none(), i < REQUIRED, "{i}");
        if let Some(absent) = parameter.absent {
            assert!(parameter.range.contains(&absent), "{}", parameter.name);
        }
    }
    let params = StreamParams::from(std::array::from_fn(|i| i as f64));
    for (i, value) in params.to_array().into_iter().enumerate() {
        let expected = PARAMETERS[i].absent.unwrap_or(i as f64);
        assert_eq!(value.to_bits(), expected.to_bits());
    }
}

#[test]
fn absent_parameters_have_no_key() {
    let mut params = StreamParams::from([0.5; REQUIRED]);
    let keys = |params: &StreamParams<f64>| {
        let json = serde_json::to_value(params).unwrap();
        json.as_object().unwrap().len()
    };
    assert_eq!(keys(&params), REQUIRED);
    let text = serde_json::to_string(&params).unwrap();
    assert_eq!(
        serde_json::from_str::<StreamParams<f64>>(&text).unwrap(),
        params
    );
    params.phi0_deg = 10.0;
    assert_eq!(keys(&params), REQUIRED + 1);
    let text = serde_json::to_string(&params).unwrap();
    assert_eq!(
        serde_json::from_str::<StreamParams<f64>>(&text).unwrap(),
        params
    );
    let marginals = StreamParams::<Option<Marginal>>::default();
    let json = serde_json::to_value(marginals).unwrap();
    assert_eq!(json.as_object().unwrap().len(), REQUIRED);
}
