//! Settings as text.

use oblate::config::to_toml;
use std::collections::BTreeMap;

#[test]
fn expert_tables_come_last_and_the_text_means_the_same() {
    let numbers = |pairs: &[(&str, f64)]| -> toml::Table {
        pairs
            .iter()
            .map(|(key, value)| ((*key).to_owned(), toml::Value::Float(*value)))
            .collect()
    };
    let mut sampler = numbers(&[("live", 500.0)]);
    sampler.insert(
        "expert".to_owned(),
        numbers(&[("replaced_fraction", 0.1)]).into(),
    );
    let settings = BTreeMap::from([
        ("nested".to_owned(), sampler),
        ("prior".to_owned(), numbers(&[("q_min", 0.5)])),
    ]);
    let text = to_toml(&settings).unwrap();
    let place = |what: &str| text.find(what).unwrap();
    assert!(place("[prior]") < place("# Expert settings"));
    assert!(place("# Expert settings") < place("[nested.expert]"));
    let read: BTreeMap<String, toml::Table> = toml::from_str(&text).unwrap();
    assert_eq!(read, settings);
}
