//! What levels look like against the original: bias beside the baselines, error at equal time, near to far.
//!
//! `cargo bench --bench appearance -- bias [MAP…] [farfield] | equal-time [SCENE…] [patches=M] | near-far`; all three without a
//! word. Maps of `fixtures/heights`, 1024², with the amplitudes of `heights.json`, 1 mm a texel.

mod bias;
mod equal_time;
mod near_far;
mod subjects;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    let wanted = |name: &str| words.is_empty() || words.iter().any(|word| word == name);
    if wanted("bias") {
        bias::run(&words);
    }
    if wanted("equal-time") {
        equal_time::run(&words);
    }
    if wanted("near-far") {
        near_far::run();
    }
}
