//! A file that lies about its size costs no memory. Alone in its process, which is what is measured.
#![cfg(target_os = "linux")]

mod sample;

use farfield_formats::asset::DOCUMENT;
use farfield_formats::{Error, SurfaceAsset};
use sample::Sample;
use std::io::Write;

/// Largest extent of the process's memory so far, touched or not, in MiB.
fn peak_mebibytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmPeak:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() / 1024
}

#[test]
fn bombs_and_absurd_sizes_allocate_nothing() {
    const BOMB: u64 = 2 << 30;
    let mut encoder = zstd::stream::Encoder::new(Vec::new(), 1).unwrap();
    (0..BOMB >> 20).for_each(|_| encoder.write_all(&[0; 1 << 20]).unwrap());
    let bomb = encoder.finish().unwrap();

    let files = Sample::SMALL.asset().encode().unwrap();
    let document = String::from_utf8(files[DOCUMENT].clone()).unwrap();
    let name = files.keys().find(|name| name.contains("heights")).unwrap();
    let mut payload = files[name][..files[name].len()].to_vec();
    let data_offset = u64::from_le_bytes(payload[80..88].try_into().unwrap()) as usize;
    payload.truncate(data_offset);
    payload[88..96].copy_from_slice(&(bomb.len() as u64).to_le_bytes());
    payload.extend(&bomb);

    let attempt = |document: &str, payload: &[u8]| {
        let old = blake3::hash(&files[name]).to_hex();
        let lying = document.replace(old.as_str(), &blake3::hash(payload).to_hex());
        SurfaceAsset::decode(&mut |path| match path {
            DOCUMENT => Ok(lying.clone().into_bytes()),
            path if path == name => Ok(payload.to_vec()),
            path => Ok(files[path].clone()),
        })
    };
    // The decoder's own buffers, once.
    assert!(attempt(&document, &files[name]).is_ok());
    let before = peak_mebibytes();

    // Two GiB in a frame of a table of 24 bytes.
    let error = attempt(&document, &payload).expect_err("a bomb");
    assert!(matches!(error, Error::Malformed { .. }), "{error}");

    // A document and a header that agree on 16384² heights (1 GiB), and a frame that ends after 24 bytes.
    let vast =
        document.replacen("\"cells\": [\n        3,\n        2", "\"cells\": [\n        16384,\n        16384", 1);
    assert_ne!(vast, document);
    let mut payload = files[name].clone();
    payload[20..28].copy_from_slice(&[16384u32.to_le_bytes(), 16384u32.to_le_bytes()].concat());
    payload[96..104].copy_from_slice(&(1u64 << 30).to_le_bytes());
    let error = attempt(&vast, &payload).expect_err("too few heights");
    assert!(error.to_string().contains("wanted 1073741824 bytes in one frame"), "{error}");

    let grown = peak_mebibytes() - before;
    // The bomb's own 64 kB, its decoder's window (8 MiB at most here) and the allocator's slack.
    assert!(grown < 64, "{grown} MiB for files of {} bytes", bomb.len());
}
