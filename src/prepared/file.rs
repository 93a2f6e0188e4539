//! Reads and writes Arrow's IPC format, for uncompressed batches without nulls; finds where a file stores its columns.
//!
//! ```text
//! "ARROW1" 0 0 | schema | batch ... | end of the stream | footer | its length: i32 | "ARROW1"
//! ```
//!
//! The schema and each batch are messages: ff ff ff ff, the length of the message's metadata (i32, a multiple of 8),
//! and the metadata. In a batch the body follows, in which each buffer begins at a multiple of 64.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::io::{self, Write};
use std::ops::Range;
use std::path::Path;

use arrow_ipc::convert::IpcSchemaEncoder;
use arrow_ipc::{
    Block, Buffer, FieldNode, Footer, FooterArgs, Message, MessageArgs, MessageHeader,
    MetadataVersion, Precision, RecordBatch, RecordBatchArgs, Type,
};
use arrow_schema::Schema;
use flatbuffers::FlatBufferBuilder;

use super::columns::{COLUMNS, ColumnType, Id, Number};
use crate::error::{Error, Result};

pub(super) const MAGIC: &[u8] = b"ARROW1\0\0";
/// Key of the schema under which the scene's metadata are stored.
const KEY: &str = "ewa_splat";
const CONTINUATION: [u8; 4] = [0xff; 4];
const ALIGNMENT: usize = 64;

/// A column of a batch to write.
#[derive(Debug)]
pub(super) struct Part<'a> {
    pub(super) id: Id,
    /// Beginning of each row's list among the elements, and the end of the last list; empty if the column has no lists.
    pub(super) offsets: Vec<i64>,
    /// Elements.
    pub(super) bytes: Cow<'a, [u8]>,
}

/// A batch to write: its columns in their order. Lists that it lacks are empty.
#[derive(Debug)]
pub(super) struct Batch<'a> {
    pub(super) rows: usize,
    pub(super) parts: Vec<Part<'a>>,
}

impl Batch<'_> {
    /// Returns the nodes and buffers of a file's columns for the message of a batch, and the length of its body.
    fn places(&self, columns: &[Id], empty: &[i64]) -> (Vec<FieldNode>, Vec<Buffer>, usize) {
        let (mut nodes, mut buffers, mut body) = (Vec::new(), Vec::new(), 0);
        self.visit(columns, empty, |piece| match piece {
            Piece::Node(count) => nodes.push(FieldNode::new(count as i64, 0)),
            Piece::Bytes(bytes) => {
                buffers.push(Buffer::new(body as i64, bytes.len() as i64));
                body += bytes.len().next_multiple_of(ALIGNMENT);
            }
        });
        (nodes, buffers, body)
    }

    /// Calls `each` for all nodes and buffers in Arrow's order: those of a column before those of its children.
    ///
    /// - `empty`: offsets of lists without elements.
    fn visit(&self, columns: &[Id], empty: &[i64], mut each: impl FnMut(Piece<'_>)) {
        for id in columns {
            let column = id.column();
            let part = self.parts.iter().find(|part| part.id == *id);
            let (offsets, bytes) = part.map_or((&empty[..=self.rows], &[][..]), |part| {
                (part.offsets.as_slice(), &*part.bytes)
            });
            let none = || Piece::Bytes(&[]);
            let count = bytes.len() / column.stride();
            if column.is_list {
                each(Piece::Node(self.rows));
                each(none());
                each(Piece::Bytes(bytemuck::cast_slice(offsets)));
            }
            each(Piece::Node(count));
            each(none());
            if column.width > 1 {
                each(Piece::Node(count * column.width));
                each(none());
            }
            each(Piece::Bytes(bytes));
        }
    }
}

/// Entry of a message, or a buffer of its body.
enum Piece<'a> {
    /// An array of so many elements.
    Node(usize),
    /// A buffer.
    Bytes(&'a [u8]),
}

/// Writes batches as a file with the columns that any of them has; returns the number of bytes written.
///
/// - `about`: metadata of the scene.
pub(super) fn write(out: &mut impl Write, about: String, batches: &[Batch<'_>]) -> io::Result<u64> {
    let parts = || batches.iter().flat_map(|batch| &batch.parts);
    let is_used = |id: &Id| parts().any(|part| part.id == *id);
    let columns: Vec<Id> = COLUMNS.iter().map(|(id, _)| *id).filter(is_used).collect();
    let fields: Vec<_> = columns.iter().map(|id| id.column().field()).collect();
    let metadata = HashMap::from([(KEY.to_owned(), about)]);
    let schema = Schema::new_with_metadata(fields, metadata);
    let most_rows = batches.iter().map(|batch| batch.rows).max().unwrap_or(0);
    let empty = vec![0; most_rows + 1];

    let mut out = Counted { out, position: 0 };
    out.write_all(MAGIC)?;
    let mut builder = FlatBufferBuilder::new();
    let header = IpcSchemaEncoder::new().schema_to_fb_offset(&mut builder, &schema);
    let header = (MessageHeader::Schema, header.as_union_value(), 0);
    write_message(&mut out, builder, header)?;
    let mut blocks = Vec::new();
    for batch in batches {
        let (nodes, buffers, body) = batch.places(&columns, &empty);
        let mut builder = FlatBufferBuilder::new();
        let nodes = builder.create_vector(&nodes);
        let buffers = builder.create_vector(&buffers);
        let header = RecordBatch::create(
            &mut builder,
            &RecordBatchArgs {
                length: batch.rows as i64,
                nodes: Some(nodes),
                buffers: Some(buffers),
                ..RecordBatchArgs::default()
            },
        );
        let header = (MessageHeader::RecordBatch, header.as_union_value(), body);
        let start = out.position;
        write_message(&mut out, builder, header)?;
        let metadata = i32::try_from(out.position - start).map_err(io::Error::other)?;
        let mut result = Ok(());
        batch.visit(&columns, &empty, |piece| {
            if let (Piece::Bytes(bytes), Ok(())) = (piece, &result) {
                result = out.write_all(bytes).and_then(|()| out.pad());
            }
        });
        result?;
        blocks.push(Block::new(start as i64, metadata, body as i64));
    }
    // End of the stream.
    out.write_all(&CONTINUATION)?;
    out.write_all(&[0; 4])?;
    let mut builder = FlatBufferBuilder::new();
    let schema = IpcSchemaEncoder::new().schema_to_fb_offset(&mut builder, &schema);
    let blocks = builder.create_vector(&blocks);
    let footer = Footer::create(
        &mut builder,
        &FooterArgs {
            version: MetadataVersion::V5,
            schema: Some(schema),
            recordBatches: Some(blocks),
            ..FooterArgs::default()
        },
    );
    builder.finish(footer, None);
    let footer = builder.finished_data();
    let len = i32::try_from(footer.len()).map_err(io::Error::other)?;
    out.write_all(footer)?;
    out.write_all(&len.to_le_bytes())?;
    out.write_all(&MAGIC[..6])?;
    out.flush()?;
    Ok(out.position)
}

/// Writes a message without its body, and pads it so that the body begins at a multiple of [`ALIGNMENT`].
fn write_message(
    out: &mut Counted<impl Write>,
    mut builder: FlatBufferBuilder<'_>,
    (kind, header, body): (
        MessageHeader,
        flatbuffers::WIPOffset<flatbuffers::UnionWIPOffset>,
        usize,
    ),
) -> io::Result<()> {
    let message = Message::create(
        &mut builder,
        &MessageArgs {
            version: MetadataVersion::V5,
            header_type: kind,
            header: Some(header),
            bodyLength: body as i64,
            ..MessageArgs::default()
        },
    );
    builder.finish(message, None);
    let data = builder.finished_data();
    let begin = out.position + 8;
    let end = (begin + data.len() as u64).next_multiple_of(ALIGNMENT as u64);
    let len = i32::try_from(end - begin).map_err(io::Error::other)?;
    out.write_all(&CONTINUATION)?;
    out.write_all(&len.to_le_bytes())?;
    out.write_all(data)?;
    out.pad()
}

/// A writer that counts its bytes.
struct Counted<W> {
    out: W,
    position: u64,
}

impl<W: Write> Counted<W> {
    /// Writes zeros up to the next multiple of [`ALIGNMENT`].
    fn pad(&mut self) -> io::Result<()> {
        let end = self.position.next_multiple_of(ALIGNMENT as u64);
        let count = usize::try_from(end - self.position).unwrap_or(0);
        self.write_all(&[0; ALIGNMENT][..count])
    }
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.out.write(bytes)?;
        self.position += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Metadata of a file, and the places of its columns.
#[derive(Debug)]
pub(super) struct Places {
    pub(super) about: String,
    pub(super) batches: Vec<BatchPlaces>,
}

/// Places of the columns of a batch.
#[derive(Debug)]
pub(super) struct BatchPlaces {
    pub(super) rows: usize,
    pub(super) columns: BTreeMap<Id, ColumnPlace>,
}

/// Place of a column's elements.
#[derive(Debug, Clone)]
pub(super) struct ColumnPlace {
    /// Range of the elements in the file, bytes.
    pub(super) part: Range<usize>,
    /// Range of the offsets of the rows' lists in the file, bytes, in a list column.
    pub(super) offsets: Range<usize>,
}

/// Returns the error that refuses a file.
pub(super) fn fault<T>(
    path: &Path,
    place: &str,
    expected: &str,
    found: impl Into<String>,
) -> Result<T> {
    let advice = "prepare the scene anew: ewa-splat convert INPUT --out FILE.arrow";
    Err(Error::format(path, place, expected, found, advice))
}

/// Finds the columns of a file. It reads no more than the schema, the footer and the headers of batches.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Places> {
    let end_of = |len: usize| bytes.len().checked_sub(len);
    let tail = end_of(6).filter(|&tail| bytes.starts_with(MAGIC) && bytes[tail..] == MAGIC[..6]);
    let Some(length_at) = tail.and_then(|_| end_of(10)) else {
        return fault(
            path,
            "end",
            "ARROW1, which ends a whole file",
            "other bytes",
        );
    };
    let length = i32::from_le_bytes(std::array::from_fn(|i| bytes[length_at + i]));
    let footer_at = usize::try_from(length)
        .ok()
        .and_then(|len| length_at.checked_sub(len));
    let Some(footer_at) = footer_at.filter(|&at| at >= MAGIC.len()) else {
        return fault(
            path,
            "footer",
            "a length within the file",
            length.to_string(),
        );
    };
    // A footer may begin anywhere: copy it to where its numbers are aligned.
    let footer_bytes = crate::scene::map::aligned(&bytes[footer_at..length_at]);
    let footer = match arrow_ipc::root_as_footer((*footer_bytes).as_ref()) {
        Ok(footer) => footer,
        Err(e) => {
            return fault(
                path,
                "footer",
                "a footer of Arrow's IPC format",
                in_one_line(&e),
            );
        }
    };
    let Some(schema) = footer.schema() else {
        return fault(path, "footer", "a schema", "none");
    };
    if schema.endianness() != arrow_ipc::Endianness::Little {
        return fault(path, "schema", "little-endian numbers", "another order");
    }
    let metadata = schema.custom_metadata().into_iter().flatten();
    let mut own = metadata.filter(|entry| entry.key() == Some(KEY));
    let Some(about) = own.next().and_then(|entry| entry.value()) else {
        let found = "a table of Arrow without it";
        return fault(
            path,
            "schema",
            "the key ewa_splat of a prepared scene",
            found,
        );
    };
    let mut columns: Vec<Id> = Vec::new();
    for field in schema.fields().into_iter().flatten() {
        let name = field.name().unwrap_or_default();
        let Some(id) = Id::named(name).filter(|id| !columns.contains(id)) else {
            return fault(
                path,
                "schema",
                "columns of a prepared scene, each once",
                format!("`{name}`"),
            );
        };
        if !is_of_type(&field, id.column()) {
            let found = format!("another type of `{name}`");
            return fault(
                path,
                "schema",
                "the column types of a prepared scene",
                found,
            );
        }
        columns.push(id);
    }
    let blocks = footer.recordBatches().into_iter().flatten();
    let batches = blocks.enumerate().map(|(i, block)| {
        let place = format!("batch {i}");
        match batch(&bytes[..footer_at], block, &columns) {
            Ok(batch) => Ok(batch),
            Err((expected, found)) => fault(path, &place, expected, found),
        }
    });
    Ok(Places {
        about: about.to_owned(),
        batches: batches.collect::<Result<_>>()?,
    })
}

/// Returns the only child of a field.
fn only_child(field: arrow_ipc::Field<'_>) -> Option<arrow_ipc::Field<'_>> {
    let children = field.children()?;
    (children.len() == 1).then(|| children.get(0))
}

/// Whether a field has the type of a column.
fn is_of_type(field: &arrow_ipc::Field<'_>, column: &ColumnType) -> bool {
    let mut element = Some(*field);
    let mut is_right = true;
    if column.is_list {
        is_right = field.type_type() == Type::LargeList;
        element = only_child(*field);
    }
    let Some(mut element) = element else {
        return false;
    };
    if column.width > 1 {
        let size = element
            .type_as_fixed_size_list()
            .map(|list| list.listSize());
        is_right &= size.and_then(|size| usize::try_from(size).ok()) == Some(column.width);
        let Some(number) = only_child(element) else {
            return false;
        };
        element = number;
    }
    let integer = element
        .type_as_int()
        .map(|int| (int.bitWidth(), int.is_signed()));
    let float = element
        .type_as_floating_point()
        .map(|float| float.precision());
    let is_number = match column.number {
        Number::U8 => integer == Some((8, false)),
        Number::U16 => integer == Some((16, false)),
        Number::I16 => integer == Some((16, true)),
        Number::U32 => integer == Some((32, false)),
        Number::F32 => float == Some(Precision::SINGLE),
        Number::F64 => float == Some(Precision::DOUBLE),
    };
    is_right && is_number && element.dictionary().is_none()
}

/// Finds the columns of a batch, or returns what was expected and what was found.
fn batch(
    bytes: &[u8],
    block: &Block,
    columns: &[Id],
) -> std::result::Result<BatchPlaces, (&'static str, String)> {
    let fault = |expected, found: String| Err((expected, found));
    let part = |start: i64, len: i64| {
        let (start, len) = (usize::try_from(start).ok()?, usize::try_from(len).ok()?);
        let end = start.checked_add(len)?;
        (end <= bytes.len()).then_some(start..end)
    };
    let metadata = i64::from(block.metaDataLength());
    let Some(message) = part(block.offset(), metadata).filter(|m| m.len() >= 8) else {
        return fault(
            "a message within the file",
            format!("one at byte {}", block.offset()),
        );
    };
    let Some(body) = part(message.end as i64, block.bodyLength()) else {
        return fault(
            "a body within the file",
            format!("{} bytes", block.bodyLength()),
        );
    };
    let [head, data] = [
        &bytes[message.start..][..8],
        &bytes[message.start + 8..message.end],
    ];
    let length = i32::from_le_bytes([head[4], head[5], head[6], head[7]]);
    if head[..4] != CONTINUATION || usize::try_from(length) != Ok(data.len()) {
        return fault("a message of Arrow's IPC format", "other bytes".into());
    }
    let message = match arrow_ipc::root_as_message(data) {
        Ok(message) => message,
        Err(e) => return fault("a message of Arrow's IPC format", in_one_line(&e)),
    };
    let Some(header) = message.header_as_record_batch() else {
        return fault("a record batch", "another message".into());
    };
    if message.version() != MetadataVersion::V5 || header.compression().is_some() {
        return fault("version 5 of the format, uncompressed", "another".into());
    }
    let Ok(rows) = usize::try_from(header.length()) else {
        return fault("a number of rows", header.length().to_string());
    };
    let mut nodes = header.nodes().into_iter().flatten();
    let mut buffers = header.buffers().into_iter().flatten();
    let mut node = || {
        let node = nodes.next().filter(|node| node.null_count() == 0)?;
        usize::try_from(node.length()).ok()
    };
    let mut buffer = |least: Option<usize>| {
        let buffer = buffers.next()?;
        let start = usize::try_from(buffer.offset()).ok()?;
        let end = start.checked_add(usize::try_from(buffer.length()).ok()?)?;
        let is_whole = end <= body.len() && least.is_some_and(|least| end - start >= least);
        is_whole.then(|| body.start + start..body.start + end)
    };
    let mut found = BTreeMap::new();
    for id in columns {
        let column = id.column();
        let mut place = || {
            let mut offsets = 0..0;
            if column.is_list {
                node().filter(|count| *count == rows)?;
                buffer(Some(0))?;
                let size = rows.checked_add(1)?.checked_mul(8)?;
                let whole = buffer(Some(size))?;
                offsets = whole.start..whole.start + size;
            }
            let count = node().filter(|count| column.is_list || *count == rows)?;
            buffer(Some(0))?;
            if column.width > 1 {
                node().filter(|numbers| Some(*numbers) == count.checked_mul(column.width))?;
                buffer(Some(0))?;
            }
            let size = count.checked_mul(column.stride())?;
            let whole = buffer(Some(size))?;
            let part = whole.start..whole.start + size;
            Some(ColumnPlace { part, offsets })
        };
        let Some(place) = place() else {
            let found = format!("something else of `{}`", column.name);
            return fault(
                "lengths and buffers that belong together, without nulls",
                found,
            );
        };
        found.insert(*id, place);
    }
    Ok(BatchPlaces {
        rows,
        columns: found,
    })
}

/// Returns the first line of a verifier's error; the rest is a trace.
fn in_one_line(error: &flatbuffers::InvalidFlatbuffer) -> String {
    let text = error.to_string();
    text.lines()
        .next()
        .unwrap_or_default()
        .trim_end_matches('.')
        .to_owned()
}
