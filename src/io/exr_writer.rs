//! Writing OpenEXR: float channels and text attributes, the same bytes for the same image.

use std::collections::BTreeMap;
use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder,
    WritableImage,
};

/// The longest name of an attribute that every reader takes, in bytes.
const MAX_NAME_BYTES: usize = 31;

/// Where the attributes begin: after the magic number and the version.
const HEADER_START: usize = 8;

/// An image of float channels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrImage {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Name and plane `[v][u]` of each channel, as `R`, `variance.R`, `samples`; in any order, names apart.
    pub channels: Vec<(String, Vec<f32>)>,
    /// Text attributes, as `farfield.scene`; names of 1 to 31 ASCII bytes.
    pub attributes: BTreeMap<String, String>,
}

/// The bytes of a single-part EXR file: scan lines in increasing order, deflated in blocks of 16.
///
/// They depend on `image` alone: no date, no host, no order of a hash map. Channels stand sorted by name, as the
/// format wants them.
///
/// # Panics
/// If a plane is not of `size`, there is none, a channel has no ASCII name or two have the same, or an attribute's name
/// is not of 1 to 31 ASCII bytes other than 0.
pub fn encode_exr(image: &ExrImage) -> Vec<u8> {
    let [width, height] = image.size;
    let names: std::collections::BTreeSet<&str> = image.channels.iter().map(|(name, _)| name.as_str()).collect();
    assert!(!names.is_empty() && names.len() == image.channels.len(), "channels, each with a name of its own");
    let channels = image.channels.iter().map(|(name, plane)| {
        assert!(is_name(name, 255), "a channel name in ASCII");
        assert_eq!(plane.len(), width * height, "one sample a pixel");
        AnyChannel::new(name.as_str(), FlatSamples::F32(plane.clone()))
    });
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let layer =
        Layer::new((width, height), LayerAttributes::default(), encoding, AnyChannels::sort(channels.collect()));
    let mut bytes = Cursor::new(Vec::new());
    // One thread: the place of a block in the file is then that of its lines.
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).expect("writing to memory cannot fail");
    with_attributes(bytes.into_inner(), &image.attributes)
}

/// Inserts text attributes before the end of the header and moves what the offset table points to.
///
/// The `exr` crate keeps attributes of free names in a hash map and writes them in its order, which changes from run to
/// run.
fn with_attributes(bytes: Vec<u8>, attributes: &BTreeMap<String, String>) -> Vec<u8> {
    let mut inserted = Vec::new();
    for (name, value) in attributes {
        assert!(is_name(name, MAX_NAME_BYTES), "an attribute name of 1 to 31 ASCII bytes");
        inserted.extend_from_slice(name.as_bytes());
        inserted.extend_from_slice(b"\0string\0");
        let length = i32::try_from(value.len()).expect("a text of less than 2 GiB");
        inserted.extend_from_slice(&length.to_le_bytes());
        inserted.extend_from_slice(value.as_bytes());
    }
    let end = header_end(&bytes);
    let (header, rest) = bytes.split_at(end);
    let (table, chunks) = rest[1..].split_at(offset_table_bytes(&rest[1..], end + 1));
    let mut out = Vec::with_capacity(bytes.len() + inserted.len());
    out.extend_from_slice(header);
    out.extend_from_slice(&inserted);
    out.push(0);
    for offset in table.as_chunks::<8>().0 {
        out.extend_from_slice(&(u64::from_le_bytes(*offset) + inserted.len() as u64).to_le_bytes());
    }
    out.extend_from_slice(chunks);
    out
}

/// Position of the zero byte that ends the header: where the name of a further attribute would stand.
fn header_end(bytes: &[u8]) -> usize {
    let text_end = |at: usize| at + bytes[at..].iter().position(|&b| b == 0).expect("a text ends with 0");
    let mut at = HEADER_START;
    while bytes[at] != 0 {
        let length = text_end(text_end(at) + 1) + 1;
        let size: [u8; 4] = bytes[length..length + 4].try_into().expect("four bytes");
        at = length + 4 + u32::from_le_bytes(size) as usize;
    }
    at
}

/// Bytes of the offset table, which stands at `start` of the file and ends where the first block begins.
fn offset_table_bytes(table: &[u8], start: usize) -> usize {
    let first = table.first_chunk().map(|offset| u64::from_le_bytes(*offset)).expect("at least one block");
    usize::try_from(first).expect("the file is in memory") - start
}

/// Whether `name` has 1 to `longest` ASCII bytes, none of them 0.
fn is_name(name: &str, longest: usize) -> bool {
    (1..=longest).contains(&name.len()) && name.is_ascii() && !name.contains('\0')
}

#[cfg(test)]
mod tests {
    use exr::prelude::{AttributeValue, ReadChannels, ReadLayers};

    use super::super::raster::{Choice, decode};
    use super::*;
    use crate::io::SourceFile;

    fn image() -> ExrImage {
        let size = [37, 41];
        let plane = |k: usize| (0..37 * 41).map(|i| (i * (k + 1)) as f32 * 0.01 - 1.0).collect();
        let names = ["R", "G", "B", "variance.R", "variance.G", "variance.B", "samples"];
        let attributes = [("farfield.scene", "shop"), ("farfield.seed", "7"), ("farfield.model", ""), ("a", "größer")];
        ExrImage {
            size,
            channels: names.iter().enumerate().map(|(k, name)| (name.to_string(), plane(k))).collect(),
            attributes: attributes.map(|(name, value)| (name.into(), value.into())).into(),
        }
    }

    #[test]
    fn what_is_read_is_what_was_written() {
        let image = image();
        let file = SourceFile::from_bytes("out.exr", encode_exr(&image));
        let colour = decode(&file, Choice::Color).unwrap();
        assert_eq!([colour.width, colour.height], image.size);
        for (plane, (_, wanted)) in colour.planes.iter().zip(&image.channels) {
            assert_eq!(plane, wanted);
        }
        for (name, wanted) in &image.channels {
            assert_eq!(decode(&file, Choice::One(Some(name))).unwrap().planes, [wanted.as_slice()], "{name}");
        }
        let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels();
        let read = reader.first_valid_layer().all_attributes().from_buffered(Cursor::new(file.bytes())).unwrap();
        let others = read.layer_data.attributes.other.iter().chain(&read.attributes.other);
        let texts: BTreeMap<_, _> = others
            .filter_map(|(name, value)| match value {
                AttributeValue::Text(text) => Some((name.to_string(), text.to_string())),
                _ => None,
            })
            .collect();
        for (name, value) in image.attributes.iter().filter(|(_, value)| value.is_ascii()) {
            assert_eq!(texts.get(name), Some(value), "{name}");
        }
    }

    #[test]
    fn the_order_of_channels_changes_no_byte() {
        let sorted = encode_exr(&image());
        let mut turned = image();
        turned.channels.reverse();
        assert_eq!(sorted, encode_exr(&turned));
        let plain = encode_exr(&ExrImage { attributes: BTreeMap::new(), ..image() });
        assert!(plain.len() < sorted.len() && decode(&SourceFile::from_bytes("a", plain), Choice::Color).is_ok());
    }
}
