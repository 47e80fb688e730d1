//! The program `beo`.

fn main() -> std::process::ExitCode {
    beo::cli::run()
}
