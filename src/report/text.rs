//! Text of figures and pages: made safe for XML and HTML, and with subscripts, superscripts and italics where it is markup.
//!
//! Markup is `_{..}` for a subscript, `^{..}` for a superscript and `*..*` for italics; a backslash before a character takes its meaning away.

/// Text made safe for XML and HTML. Control characters, which neither may hold, become U+FFFD.
#[must_use]
pub fn escape(text: &str) -> String {
    let allowed = |c: char| match c {
        '\t' | '\n' | '\r' => true,
        '\u{fffe}' | '\u{ffff}' => false,
        c => !c.is_control(),
    };
    let text: String = text
        .chars()
        .map(|c| {
            if allowed(c) {
                c
            } else {
                char::REPLACEMENT_CHARACTER
            }
        })
        .collect();
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// How a piece of markup is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// As it is.
    Plain,
    /// In italics.
    Italic,
    /// A subscript.
    Sub,
    /// A superscript.
    Super,
}

/// The pieces of markup, none of them empty.
#[must_use]
pub fn pieces(markup: &str) -> Vec<(Style, String)> {
    let mut pieces = Vec::new();
    let (mut style, mut text) = (Style::Plain, String::new());
    let mut chars = markup.chars().peekable();
    while let Some(c) = chars.next() {
        let next = match c {
            '\\' => {
                text.extend(chars.next());
                continue;
            }
            '*' if style == Style::Italic => Style::Plain,
            '*' => Style::Italic,
            '_' | '^' if chars.next_if_eq(&'{').is_some() => match c {
                '_' => Style::Sub,
                _ => Style::Super,
            },
            '}' if matches!(style, Style::Sub | Style::Super) => Style::Plain,
            other => {
                text.push(other);
                continue;
            }
        };
        if !text.is_empty() {
            pieces.push((style, std::mem::take(&mut text)));
        }
        style = next;
    }
    if !text.is_empty() {
        pieces.push((style, text));
    }
    pieces
}

/// A text that may have any characters as markup that shows it as it is.
#[must_use]
pub fn literal(text: &str) -> String {
    let mut markup = String::new();
    for c in text.chars() {
        if "\\*_^}".contains(c) {
            markup.push('\\');
        }
        markup.push(c);
    }
    markup
}

/// Markup as HTML.
#[must_use]
pub fn html(markup: &str) -> String {
    let pieces = pieces(markup).into_iter();
    let set = pieces.map(|(style, text)| {
        let text = escape(&text);
        match style {
            Style::Plain => text,
            Style::Italic => format!("<i>{text}</i>"),
            Style::Sub => format!("<sub>{text}</sub>"),
            Style::Super => format!("<sup>{text}</sup>"),
        }
    });
    set.collect()
}

/// Words of a message as HTML: what stands between backticks is code.
#[must_use]
pub fn prose(message: &str) -> String {
    let parts = message.split('`').enumerate();
    let set = parts.map(|(k, part)| match (k % 2, escape(part)) {
        (1, code) => format!("<code>{code}</code>"),
        (_, words) => words,
    });
    set.collect()
}
