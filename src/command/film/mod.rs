//! Writes films: AV1 in an MP4 file.

mod container;
mod planes;

use std::fs::File;
use std::io::{self, Seek, Write};
use std::path::{Path, PathBuf};

use rav1e::prelude::{
    ChromaSamplePosition, ColorDescription, ColorPrimaries, Config, Context, EncoderConfig,
    EncoderStatus, FrameType, MatrixCoefficients, PixelRange, Rational, SpeedSettings,
    TransferCharacteristics,
};

use self::container::{Sample, Track, sample_of};
use crate::image::{byte, srgb_from_linear};
use crate::io::write_atomically;
use crate::{Error, Image, Result};

/// Quantizer of the encoder, 0 to 255: pictures of volumes come back within 46 dB.
const QUANTIZER: usize = 60;
/// Speed of the encoder, 0 to 10.
const SPEED: u8 = 10;
/// Seconds from one picture that a player may start at to the next.
const SECONDS_OF_GROUP: u64 = 2;
/// Pixels of a tile, at least. Tiles are encoded in parallel; their number does not depend on the machine.
const TILE_PIXELS: usize = 1 << 18;

/// AV1's levels for films, from 4.0 on: number, greatest area, greatest sides, and pixels per second (annex A.3 of the
/// standard). The levels below limit small pictures to less than 12 Mbit/s.
const LEVELS: [(u8, u64, [usize; 2], u64); 8] = [
    (8, 2_359_296, [6144, 3456], 70_778_880),
    (9, 2_359_296, [6144, 3456], 141_557_760),
    (12, 8_912_896, [8192, 4352], 267_386_880),
    (13, 8_912_896, [8192, 4352], 534_773_760),
    (14, 8_912_896, [8192, 4352], 1_069_547_520),
    (16, 35_651_584, [16_384, 8704], 1_069_547_520),
    (17, 35_651_584, [16_384, 8704], 2_139_095_040),
    (18, 35_651_584, [16_384, 8704], 4_278_190_080),
];
/// Level without limits.
const ANY_LEVEL: u8 = 31;
/// Least and greatest side.
const SIDES: [usize; 2] = [16, 16_384];

/// Encoder of a film, which keeps finished pictures in a file without a name.
pub(super) struct Film {
    path: PathBuf,
    encoder: Context<u8>,
    track: Track,
    data: File,
    /// Number of pixels that are not opaque.
    transparent: usize,
}

fn fault(path: &Path, place: &'static str, expected: &str, found: impl Into<String>) -> Error {
    let advice = "choose another size, or --out NAME_%04d.png";
    Error::format(path, place, expected, found, advice)
}

impl Film {
    /// Opens a film.
    ///
    /// - `size`: width and height in pixels.
    /// - `rate`: pictures per second.
    pub(super) fn new(path: &Path, size: [usize; 2], rate: u16) -> Result<Self> {
        let [width, height] = size;
        let area = width as u64 * height as u64;
        let sides = size.map(|side| u16::try_from(side).unwrap_or(u16::MAX));
        if size
            .iter()
            .any(|side| !(SIDES[0]..=SIDES[1]).contains(side))
            || area > LEVELS[7].1
        {
            let expected = format!(
                "sides of {} to {} pixels, {} pixels at most",
                SIDES[0], SIDES[1], LEVELS[7].1
            );
            let found = format!("{width} x {height}");
            return Err(fault(path, "size of a film", &expected, found));
        }
        let fits = |(_, most, [wide, high], second): &&(u8, u64, [usize; 2], u64)| {
            let is_fast = area * u64::from(rate) <= *second;
            area <= *most && width <= *wide && height <= *high && is_fast
        };
        let level = LEVELS.iter().find(fits).map_or(ANY_LEVEL, |level| level.0);
        let mut speed_settings = SpeedSettings::from_preset(SPEED);
        // Each picture is encoded as it comes, so that few wait in memory.
        speed_settings.rdo_lookahead_frames = 1;
        let config = EncoderConfig {
            width,
            height,
            time_base: Rational::new(1, rate.into()),
            chroma_sample_position: ChromaSamplePosition::Vertical,
            pixel_range: PixelRange::Limited,
            color_description: Some(ColorDescription {
                color_primaries: ColorPrimaries::BT709,
                transfer_characteristics: TransferCharacteristics::SRGB,
                matrix_coefficients: MatrixCoefficients::BT709,
            }),
            level_idx: Some(level),
            min_key_frame_interval: 0,
            max_key_frame_interval: SECONDS_OF_GROUP * u64::from(rate),
            low_latency: true,
            quantizer: QUANTIZER,
            tiles: (width * height / TILE_PIXELS).clamp(1, 64),
            speed_settings,
            ..EncoderConfig::default()
        };
        let encoder = Config::new().with_encoder_config(config).new_context();
        let encoder =
            encoder.map_err(|e| fault(path, "encoding", "a film's size", e.to_string()))?;
        let folder = path.parent().filter(|own| !own.as_os_str().is_empty());
        let data = tempfile::tempfile_in(folder.unwrap_or(Path::new(".")));
        Ok(Self {
            path: path.into(),
            encoder,
            track: Track {
                size: sides,
                rate,
                samples: Vec::new(),
                sequence: Vec::new(),
            },
            data: data.map_err(|e| failed(path, e))?,
            transparent: 0,
        })
    }

    /// Adds a picture, over black.
    pub(super) fn push(&mut self, image: &Image) -> Result<()> {
        let size = self.track.size.map(usize::from);
        if [image.width, image.height] != size {
            let found = format!("{} x {}", image.width, image.height);
            let expected = format!("{} x {} pixels", size[0], size[1]);
            return Err(fault(&self.path, "picture", &expected, found));
        }
        // Colours are premultiplied: over black they stay as they are.
        let pixels: Vec<[u8; 3]> = { image.pixels.iter() }
            .map(|&[r, g, b, _]| [r, g, b].map(|c| byte(srgb_from_linear(c))))
            .collect();
        // Just below 1 is rounding.
        self.transparent += image.pixels.iter().filter(|own| own[3] < 0.998).count();
        let own = planes::planes(&pixels, size);
        let mut frame = self.encoder.new_frame();
        let half = size[0].div_ceil(2);
        let rows = [
            (&own.luma, size[0]),
            (&own.chroma[0], half),
            (&own.chroma[1], half),
        ];
        for (plane, (bytes, width)) in frame.planes.iter_mut().zip(rows) {
            plane.copy_from_raw_u8(bytes, width, 1);
        }
        let sent = self.encoder.send_frame(frame);
        sent.map_err(|e| self.refused(e))?;
        self.receive()
    }

    /// Stores the pictures that are ready.
    fn receive(&mut self) -> Result<()> {
        loop {
            match self.encoder.receive_packet() {
                Ok(packet) => {
                    let is_key = packet.frame_type == FrameType::KEY;
                    self.store(&packet.data, is_key)
                        .map_err(|e| failed(&self.path, e))?;
                }
                Err(EncoderStatus::Encoded) => {}
                Err(EncoderStatus::NeedMoreData | EncoderStatus::LimitReached) => return Ok(()),
                Err(e) => return Err(self.refused(e)),
            }
        }
    }

    fn store(&mut self, packet: &[u8], is_key: bool) -> io::Result<()> {
        let (sample, sequence) = sample_of(packet)?;
        if let Some(sequence) = sequence.filter(|_| self.track.sequence.is_empty()) {
            self.track.sequence = sequence.to_vec();
        }
        let bytes = u32::try_from(sample.len()).map_err(io::Error::other)?;
        self.track.samples.push(Sample { bytes, is_key });
        self.data.write_all(&sample)
    }

    fn refused(&self, status: EncoderStatus) -> Error {
        fault(&self.path, "encoding", "pictures", status.to_string())
    }

    /// Writes the file, and returns whether pictures were transparent.
    pub(super) fn finish(mut self) -> Result<bool> {
        self.encoder.flush();
        self.receive()?;
        let Self {
            path,
            track,
            mut data,
            transparent,
            ..
        } = self;
        write_atomically(&path, |file| {
            file.write_all(&track.head()?)?;
            data.rewind()?;
            io::copy(&mut data, file)
        })?;
        Ok(transparent > 0)
    }
}

fn failed(path: &Path, error: io::Error) -> Error {
    let advice = "check the folder, its permissions and the disk";
    Error::io(path, "writing the film", error, advice)
}
