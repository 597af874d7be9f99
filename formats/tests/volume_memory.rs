//! A volume file that lies about its size costs no memory. Alone in its process, which is what is measured.
#![cfg(target_os = "linux")]

mod sample_volume;

use farfield_formats::Error;
use farfield_formats::asset::DOCUMENT;
use farfield_formats::volume::VolumeAsset;
use sample_volume::Sample;

/// Largest extent of the process's memory so far, touched or not, in MiB.
fn peak_mebibytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmPeak:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() / 1024
}

#[test]
fn absurd_sizes_allocate_nothing() {
    let files = Sample::SMALL.asset().encode().unwrap();
    let document = String::from_utf8(files[DOCUMENT].clone()).unwrap();
    let name = files.keys().find(|name| name.contains("bricks")).unwrap();
    let attempt = |document: &str, payload: &[u8]| {
        let old = blake3::hash(&files[name]).to_hex();
        let lying = document.replace(old.as_str(), &blake3::hash(payload).to_hex());
        VolumeAsset::decode(&mut |path| match path {
            DOCUMENT => Ok(lying.clone().into_bytes()),
            path if path == name => Ok(payload.to_vec()),
            path => Ok(files[path].clone()),
        })
    };
    // The decoder's own buffers, once.
    assert!(attempt(&document, &files[name]).is_ok());
    let before = peak_mebibytes();

    // A document and a header that agree on 256 × 256 × 128 bricks (32 MiB of index, 4 GiB of voxels), and a frame of 4 bytes.
    let sizes = "\"size\": [\n        5,\n        4,\n        3";
    let vast = document.replacen(sizes, "\"size\": [\n        2048,\n        2048,\n        1023", 1);
    assert_ne!(vast, document);
    let mut payload = files[name].clone();
    let size: Vec<u8> = [256u32, 256, 128].iter().flat_map(|n| n.to_le_bytes()).collect();
    payload[20..32].copy_from_slice(&size);
    payload[96..104].copy_from_slice(&(4u64 * 256 * 256 * 128).to_le_bytes());
    let error = attempt(&vast, &payload).expect_err("too few bricks");
    assert!(error.to_string().contains("wanted 33554432 bytes in one frame, found 4 bytes"), "{error}");

    // As many stored bricks as a level may have, in an atlas to match, and textures of one brick.
    let bricks = document.replacen("\"bricks\": 1,", "\"bricks\": 524289,", 1).replacen(sizes, &vast_size(), 1);
    let error = attempt(&bricks, &files[name]).expect_err("more bricks than a level may store");
    assert!(error.to_string().contains("`bricks`: wanted 0 to 524288, found 524289"), "{error}");
    assert!(matches!(error, Error::Malformed { .. }));

    let grown = peak_mebibytes() - before;
    // A decoder's window and the allocator's slack.
    assert!(grown < 32, "{grown} MiB");
}

fn vast_size() -> String {
    "\"size\": [\n        2048,\n        2048,\n        1023".into()
}
