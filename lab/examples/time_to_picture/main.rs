//! Times whole commands: from data on disk to the image.
//!
//!     cargo build --release
//!     cargo run --release -p ewa-splat-lab --example time_to_picture [--only WORD] [PROGRAM ...]
//!
//! Each given program runs every command in turn; the default is the program beside this example. Builds are thus
//! compared on the same machine in the same minutes. Prints Markdown: the times of each stage from `--stats`, the
//! processor time, and the peak memory of the process (where the system reports it). Data are generated once, in
//! `time_to_picture` in the system's temporary folder.

#[path = "../scenes/mod.rs"]
mod scenes;

mod files;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A command: its name in the table, its input file, and its arguments.
struct Work {
    name: &'static str,
    file: fn(&Path) -> std::io::Result<PathBuf>,
    arguments: &'static str,
}

/// Commands to time; `{}` is the folder of the data.
const WORKS: [Work; 18] = [
    Work {
        name: "1 M SPH particles, column density",
        file: files::sph,
        arguments: "--column-density --field rho",
    },
    Work {
        name: "1 M SPH particles, by value",
        file: files::sph,
        arguments: "--field rho --classify particle",
    },
    Work {
        name: "1 M SPH particles, no option but the field",
        file: files::sph,
        arguments: "--field rho",
    },
    Work {
        name: "1 M ellipsoids",
        file: files::ellipsoids,
        arguments: "",
    },
    Work {
        name: "20 M spheres, 1024 x 1024",
        file: files::spheres,
        arguments: "--size 1024x1024",
    },
    Work {
        name: "curvilinear 128^3 .vts",
        file: files::curvilinear,
        arguments: "",
    },
    Work {
        name: "curvilinear 128^3 .vts, by value, soft",
        file: files::curvilinear,
        arguments: "--classify particle --boundary soft",
    },
    Work {
        name: "945,000 tetrahedra .vtu",
        file: files::tetrahedra,
        arguments: "",
    },
    Work {
        name: "945,000 tetrahedra .vtu, by value, soft",
        file: files::tetrahedra,
        arguments: "--classify particle --boundary soft",
    },
    Work {
        name: "textured box, surfels as the picture needs",
        file: files::textured_box,
        arguments: "",
    },
    Work {
        name: "textured box, a million surfels",
        file: files::textured_box,
        arguments: "--density 41667",
    },
    Work {
        name: "small picture",
        file: files::small,
        arguments: "--size 256x256",
    },
    Work {
        name: "small picture, --backend auto",
        file: files::small,
        arguments: "--size 256x256 --backend auto",
    },
    Work {
        name: "regular 256^3 bytes, a third visible",
        file: files::lattice,
        arguments: "--type u8 --dims 256,256,256 --transfer-function {}/third.json",
    },
    Work {
        name: "the same, no option but the size",
        file: files::lattice,
        arguments: "--type u8 --dims 256,256,256",
    },
    Work {
        name: "1 M ellipsoids, box clip",
        file: files::ellipsoids,
        arguments: "--clip -0.9,-0.9,-0.9,0.9,0.9,0.9",
    },
    Work {
        name: "1 M ellipsoids, a plane",
        file: files::ellipsoids,
        arguments: "--clip 0.8,0.5,0.3,0",
    },
    Work {
        name: "from inside 100,000 ellipsoids, 170 degrees",
        file: files::few_ellipsoids,
        arguments: "--eye 0,0,0 --target 1,0,0 --fov 170",
    },
];

/// One run of a program.
struct Run {
    wall: Duration,
    /// User and system time, and the peak resident memory in bytes, where the system reports them.
    cpu_s: Option<f64>,
    peak: Option<u64>,
    stats: serde_json::Value,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut only = None;
    let mut programs = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--only" {
            only = arguments.next();
        } else {
            programs.push(PathBuf::from(argument));
        }
    }
    if programs.is_empty() {
        let folder = std::env::current_exe()?;
        let folder = folder.ancestors().nth(2).ok_or("no folder")?;
        programs.push(folder.join(format!("ewa-splat{}", std::env::consts::EXE_SUFFIX)));
    }
    let folder = std::env::temp_dir().join("time_to_picture");
    std::fs::create_dir_all(&folder)?;
    files::transfer_function(&folder)?;
    println!("| work | program | whole | read | prepare | frame | CPU | peak memory |");
    println!("|---|---|---|---|---|---|---|---|");
    for work in &WORKS {
        if only
            .as_ref()
            .is_some_and(|word| !work.name.contains(word.as_str()))
        {
            continue;
        }
        let file = (work.file)(&folder)?;
        for (i, program) in programs.iter().enumerate() {
            let run = run(program, work, &file, &folder)?;
            let ms = |name: &str| match run.stats["times_ms"][name].as_f64() {
                Some(ms) => seconds(ms / 1000.0),
                None => "-".into(),
            };
            println!(
                "| {} | {} | {} | {} | {} | {} | {} | {} |",
                if i == 0 { work.name } else { "" },
                i + 1,
                seconds(run.wall.as_secs_f64()),
                ms("read"),
                ms("prepare"),
                ms("frame"),
                run.cpu_s.map_or("-".into(), seconds),
                run.peak
                    .map_or("-".into(), |b| format!("{} MB", b / 1_000_000)),
            );
        }
    }
    Ok(())
}

/// Formats a time with two significant digits where they matter.
fn seconds(s: f64) -> String {
    if s < 0.1 {
        format!("{:.0} ms", s * 1000.0)
    } else {
        format!("{s:.2} s")
    }
}

fn run(program: &Path, work: &Work, file: &Path, folder: &Path) -> Result<Run, Box<dyn Error>> {
    let (stats, picture) = (folder.join("stats.json"), folder.join("picture.png"));
    let arguments = work.arguments.replace("{}", &folder.to_string_lossy());
    let mut command = Command::new(program);
    command.arg("render").arg(file);
    if !arguments.contains("--backend") {
        command.args(["--backend", "cpu"]);
    }
    if !arguments.contains("--size") {
        command.args(["--size", "512x512"]);
    }
    command.args(arguments.split_whitespace());
    command
        .arg("--stats")
        .arg(&stats)
        .arg("--out")
        .arg(&picture);
    let start = Instant::now();
    let mut child = command.stderr(Stdio::null()).spawn()?;
    let (mut peak, mut cpu_s) = (None, None);
    // A process that has ended keeps its times until it is waited for, but not its memory.
    while !has_ended(child.id()) {
        peak = peak_memory(child.id()).or(peak);
        cpu_s = processor_time(child.id()).or(cpu_s);
        if cfg!(not(target_os = "linux")) {
            break;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    cpu_s = processor_time(child.id()).or(cpu_s);
    let status = child.wait()?;
    let wall = start.elapsed();
    if !status.success() {
        return Err(format!("{command:?}: {status}").into());
    }
    let stats = serde_json::from_slice(&std::fs::read(&stats)?)?;
    Ok(Run {
        wall,
        cpu_s,
        peak,
        stats,
    })
}

/// Returns the fields of a process's line of state after its name.
fn state(process: u32) -> Option<Vec<String>> {
    let line = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let (_, fields) = line.rsplit_once(')')?;
    Some(fields.split_whitespace().map(str::to_owned).collect())
}

fn has_ended(process: u32) -> bool {
    state(process).is_none_or(|fields| fields[0] == "Z")
}

/// Returns user and system time, seconds; a clock tick is a hundredth.
fn processor_time(process: u32) -> Option<f64> {
    let fields = state(process)?;
    let ticks = |i: usize| fields.get(i)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / 100.0)
}

/// Returns the peak resident memory so far, bytes.
fn peak_memory(process: u32) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(
        line.trim()
            .strip_suffix(" kB")?
            .trim()
            .parse::<u64>()
            .ok()?
            * 1024,
    )
}
