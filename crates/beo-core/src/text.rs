//! Text from files, as a message can repeat it.

use std::borrow::Cow;

/// `text` on one line and without control characters, which a terminal would obey.
pub fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

/// `text` for a terminal: line ends and tabs stay, other control characters, which a terminal would obey, are written out.
pub fn for_terminal(text: &str) -> Cow<'_, str> {
    let is_obeyed = |c: char| c.is_control() && c != '\n' && c != '\t';
    if !text.contains(is_obeyed) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        if is_obeyed(c) { shown.extend(c.escape_default()) } else { shown.push(c) }
    }
    Cow::Owned(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_would_obey_is_written_out() {
        assert_eq!(for_terminal("a\tb\nüber"), "a\tb\nüber");
        assert_eq!(for_terminal("\u{1b}[2Ja\rb\u{9b}31m\u{7}"), "\\u{1b}[2Ja\\rb\\u{9b}31m\\u{7}");
    }
}
