//! Checkpoints of killed processes, damaged checkpoints, and checkpoints that cannot be written.

use oblate_samplers::{Error, checkpoint};

#[test]
fn the_previous_checkpoint_is_the_last_one_of_a_process_killed_while_it_saved() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    for state in [1_u64, 2] {
        checkpoint::save(&path, 5, 7, &state).unwrap();
    }
    let previous = checkpoint::previous(&path);
    assert_eq!(
        checkpoint::load(&path, 5, 7, |_: &u64| Ok(())).unwrap(),
        (2_u64, None)
    );
    // Killed before the new file replaced the last one.
    std::fs::rename(&path, &previous).unwrap();
    assert!(checkpoint::exists(&path));
    assert_eq!(
        checkpoint::load(&path, 5, 7, |_: &u64| Ok(())).unwrap(),
        (2_u64, None)
    );
    // A fault of the only existing file is reported with its name.
    std::fs::write(&previous, b"oblateck").unwrap();
    let words = checkpoint::load::<u64>(&path, 5, 7, |_| Ok(()))
        .unwrap_err()
        .to_string();
    assert!(words.contains("checkpoint.previous"), "{words}");
    std::fs::remove_file(&previous).unwrap();
    assert!(!checkpoint::exists(&path));
    assert!(matches!(
        checkpoint::load::<u64>(&path, 5, 7, |_| Ok(())),
        Err(Error::Io { .. })
    ));
}

#[test]
fn a_checkpoint_that_cannot_be_saved_leaves_the_last_one_in_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    checkpoint::save(&path, 5, 7, &1_u64).unwrap();
    // A folder in the way of the previous checkpoint: it cannot be replaced by a file.
    std::fs::create_dir(checkpoint::previous(&path)).unwrap();
    let error = checkpoint::save(&path, 5, 7, &2_u64).unwrap_err();
    assert!(matches!(error, Error::Io { .. }), "{error}");
    assert_eq!(
        checkpoint::load(&path, 5, 7, |_: &u64| Ok(())).unwrap(),
        (1_u64, None)
    );
    let left = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 2, "the temporary file is gone");
}
