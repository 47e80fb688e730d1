//! Fixed-size text fields: UTF-8, padded with NUL.

/// The text as a fixed-size field: cut at a character boundary if it is longer than `N` bytes, padded with NUL otherwise.
pub fn to_field<const N: usize>(text: &str) -> [u8; N] {
    let mut end = text.len().min(N);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let mut field = [0; N];
    field[..end].copy_from_slice(&text.as_bytes()[..end]);
    field
}

/// The text in a fixed-size field, up to the first NUL. Bytes that are not UTF-8 end the text: the field comes from another process.
pub fn from_field(field: &[u8]) -> &str {
    let end = field.iter().position(|&byte| byte == 0).unwrap_or(field.len());
    match std::str::from_utf8(&field[..end]) {
        Ok(text) => text,
        Err(error) => std::str::from_utf8(&field[..error.valid_up_to()]).unwrap_or(""),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_fields_round_trip_and_are_cut_at_character_boundaries() {
        assert_eq!(from_field(&to_field::<8>("chair")), "chair");
        assert_eq!(from_field(&to_field::<8>("")), "");
        assert_eq!(from_field(&to_field::<8>("12345678")), "12345678");
        assert_eq!(from_field(&to_field::<8>("1234567ä")), "1234567");
        assert_eq!(from_field(b"ab\xffcd"), "ab");
        assert_eq!(from_field(b"\xff\xff"), "");
    }
}
