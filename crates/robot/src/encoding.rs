//! Bytes of a text file to a text.

/// The text, and a line if it was not UTF-8. The byte order mark, or where there is none the place of the first
/// characters' zero bytes, tells UTF-16; a declaration of Latin-1 is believed.
pub(crate) fn decode(bytes: &[u8]) -> Result<(String, Option<String>), String> {
    let (text, found) = match bytes {
        [0xEF, 0xBB, 0xBF, rest @ ..] => (utf8(rest)?, None),
        [0xFF, 0xFE, 0, 0, ..] | [0, 0, 0xFE, 0xFF, ..] => return Err(cure("UTF-32")),
        [0xFF, 0xFE, rest @ ..] => (utf16(rest, u16::from_le_bytes)?, Some("UTF-16 (little-endian)")),
        [0xFE, 0xFF, rest @ ..] => (utf16(rest, u16::from_be_bytes)?, Some("UTF-16 (big-endian)")),
        [first, 0, _, 0, ..] if *first != 0 => (utf16(bytes, u16::from_le_bytes)?, Some("UTF-16 (little-endian)")),
        [0, first, 0, _, ..] if *first != 0 => (utf16(bytes, u16::from_be_bytes)?, Some("UTF-16 (big-endian)")),
        _ => match (utf8(bytes), declared(bytes).as_deref()) {
            (Ok(text), _) => (text, None),
            (Err(_), Some("iso-8859-1" | "latin1" | "us-ascii")) => {
                (bytes.iter().map(|&byte| char::from(byte)).collect(), Some("ISO-8859-1"))
            }
            (Err(_), Some(name)) => return Err(cure(name)),
            (Err(problem), None) => return Err(problem),
        },
    };
    Ok(match found {
        // From here on it is UTF-8, and so should it say.
        Some(name) => (without_declaration(&text), Some(format!("it is encoded as {name}, read as such"))),
        None => (text, None),
    })
}

fn cure(name: &str) -> String {
    format!(
        "it is encoded as {name}, expected UTF-8: convert it, `iconv -f {name} -t UTF-8`, and correct its first line"
    )
}

fn utf8(bytes: &[u8]) -> Result<String, String> {
    String::from_utf8(bytes.to_vec()).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = 1 + bytes[..at].iter().filter(|&&byte| byte == b'\n').count();
        format!("it is not UTF-8 (byte {at}, line {line}): convert it, for example `iconv -f ISO-8859-1 -t UTF-8`")
    })
}

fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Result<String, String> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    let units: Vec<u16> = pairs.iter().map(|&pair| unit(pair)).collect();
    match String::from_utf16(&units) {
        Ok(text) if rest.is_empty() => Ok(text),
        _ => Err("it is neither UTF-8 nor whole UTF-16".to_owned()),
    }
}

/// The encoding that an XML declaration names, in small letters.
fn declared(bytes: &[u8]) -> Option<String> {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(200)]).to_lowercase();
    let declaration = head.strip_prefix("<?xml")?.split_once("?>")?.0;
    let value = declaration.split_once("encoding")?.1.trim_start().strip_prefix('=')?.trim_start();
    let quote = value.chars().next().filter(|c| "\"'".contains(*c))?;
    Some(value[1..].split_once(quote)?.0.to_owned())
}

/// The text without its XML declaration, on as many lines as before.
fn without_declaration(text: &str) -> String {
    match text.strip_prefix("<?xml").and_then(|rest| rest.split_once("?>")) {
        Some((_, rest)) => rest.to_owned(),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::decode;

    const XML: &str = "<?xml version=\"1.0\" encoding=\"UTF-16\"?>\n<robot name=\"Käfer\"/>";
    const LEFT: &str = "\n<robot name=\"Käfer\"/>";

    #[test]
    fn utf16_of_either_order_with_and_without_a_mark() {
        let little: Vec<u8> = XML.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let big: Vec<u8> = XML.encode_utf16().flat_map(u16::to_be_bytes).collect();
        for bytes in
            [little.clone(), big.clone(), [vec![0xFF, 0xFE], little].concat(), [vec![0xFE, 0xFF], big].concat()]
        {
            let (text, note) = decode(&bytes).expect("UTF-16");
            assert_eq!(text, LEFT);
            assert!(note.is_some_and(|note| note.contains("UTF-16")));
        }
    }

    #[test]
    fn what_is_declared_is_believed_or_named() {
        assert_eq!(decode(b"\xEF\xBB\xBF<a/>"), Ok(("<a/>".to_owned(), None)));
        let latin = b"<?xml version='1.0' encoding='ISO-8859-1'?><a b='\xE4'/>";
        assert_eq!(decode(latin).expect("Latin-1").0, "<a b='ä'/>");
        let kana = b"<?xml version='1.0' encoding='Shift_JIS'?><a b='\x83\x41'/>";
        assert!(decode(kana).expect_err("another encoding").contains("shift_jis"));
        assert!(decode(b"\n<a b='\xE4'/>").expect_err("none").contains("line 2"));
        assert!(decode(b"\xFF\xFEa").expect_err("half a character").contains("UTF-16"));
    }
}
