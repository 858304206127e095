//! Damaged files, for the tests of loaders.

/// A file with a few edits of the kinds that editors, merges and full disks make. `random` gives numbers in [-1, 1).
pub fn mutated(original: &str, mut random: impl FnMut() -> f64) -> String {
    let mut text = original.as_bytes().to_vec();
    let mut pick = |below: usize| ((0.5 * (random() + 1.0)) * below as f64) as usize % below.max(1);
    let edits = 1 + pick(4);
    for _ in 0..edits {
        if text.is_empty() {
            break;
        }
        let (a, b) = (pick(text.len()), pick(text.len()));
        let (from, to) = (a.min(b), a.max(b));
        let near = (from + 1 + pick(40)).min(text.len());
        match pick(9) {
            0 => text.truncate(from),
            1 => drop(text.drain(from..near)),
            2 => drop(text.drain(from..to)),
            3 => {
                let copy = text[from..near].to_vec();
                text.splice(to..to, copy);
            }
            4 => text[from] = [b'<', b'>', b'"', b'/', b'&', b' ', b'-', b'e', b'\n', 0xff][pick(10)],
            5 => {
                let bit = 1 << pick(8);
                text[from] ^= bit;
            }
            6 => {
                // The next number becomes another one.
                let quote = text[from..].iter().position(|&c| c == b'"').map(|k| from + k + 1);
                let Some(start) = quote.filter(|&k| k < text.len()) else { continue };
                let end = text[start..].iter().position(|&c| c == b'"').map_or(text.len(), |k| start + k);
                let number =
                    ["NaN", "-1", "0", "1e308", "-inf", "1e-320", "", "0 0 0", "99999999999999999999"][pick(9)];
                text.splice(start..end, number.bytes());
            }
            7 => {
                let element =
                    ["<link name=\"x\"/>", "<joint/>", "<robot>", "</robot>", "<!--", "<![CDATA[", "<?xml?>", "<a>"]
                        [pick(8)];
                text.splice(from..from, element.bytes());
            }
            _ => text.swap(from, to),
        }
    }
    String::from_utf8_lossy(&text).into_owned()
}
