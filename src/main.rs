//! The `farfield` binary: one call into the library's command line.

fn main() -> std::process::ExitCode {
    farfield::cli::main()
}
