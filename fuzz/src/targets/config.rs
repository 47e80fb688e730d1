//! The TOML of `beo serve --config`.

use beo::cli::Configuration;

/// A configuration file.
pub fn run(data: &[u8]) {
    if let Ok(text) = std::str::from_utf8(data)
        && let Err(line) = Configuration::parse(text)
    {
        assert!(!line.contains(char::is_control), "an error of one line that a terminal can show");
    }
}

/// A small multiple of the file.
pub fn most_bytes(len: usize) -> usize {
    256 * len + (1 << 20)
}

/// Seeds.
pub fn seeds() -> Vec<Vec<u8>> {
    let texts = [
        "# all settings\nmodel = \"my.safetensors\"\ninstance = 'kitchen'\nmethod = \"auto\"\npose = \"yaw\"\nprior = \"training\"\n",
        "model = \"\"\"a\\u00e9\\\n  b\"\"\"\ninstance = '''x'''\n",
        "method = { a = [1, 2.5e3, 0x1f, inf, nan, 1979-05-27T07:32:00Z, true], \"b\".c = {} }\n[[x]]\ny = [[[]]]\n[a.b.c]\n",
    ];
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}
