//! Tests the shaders as text in Chromium, whose compiler differs from that of the other tests, at the limits that
//! WebGPU guarantees.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::shader::Shader;
use crate::breadth::some;

/// Names of the program.
const PROGRAMS: [&str; 4] = [
    "chromium-headless-shell",
    "chromium",
    "chromium-browser",
    "google-chrome",
];

/// Longest time until the browser asks for the page. One that does not start at all tests nothing.
const START: Duration = Duration::from_secs(60);

/// Longest time that the browser may take: its pipelines are made by a processor.
const LIMIT: Duration = Duration::from_secs(900);

/// A page that compiles all shaders, and sends its findings back.
const PAGE: &str = r"<!doctype html><script type=module>
const found = [];
try {
    const adapter = await navigator.gpu?.requestAdapter();
    if (!adapter) throw 'no adapter';
    const device = await adapter.requestDevice();
    for (const { name, source } of await (await fetch('shaders')).json()) {
        const module = device.createShaderModule({ code: source });
        const { messages } = await module.getCompilationInfo();
        for (const m of messages) {
            const line = source.split('\n')[m.lineNum - 1];
            found.push(`${name}: ${m.type}: ${m.message}: ${line}`);
        }
        const entries = ALL ? source.matchAll(/@compute[^{]*?fn\s+(\w+)/g) : [];
        for (const [, entryPoint] of entries) {
            device.pushErrorScope('validation');
            device.createComputePipeline({ layout: 'auto', compute: { module, entryPoint } });
            const error = await device.popErrorScope();
            if (error) found.push(`${name}, ${entryPoint}: ${error.message}`);
        }
    }
} catch (error) {
    found.push(`${error}`);
}
await fetch('found', { method: 'POST', body: JSON.stringify(found) });
</script>";

/// A browser, which ends with the test.
struct Browser(Child);

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn program() -> Option<PathBuf> {
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    let mut all = PROGRAMS
        .iter()
        .flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    all.find(|path| path.is_file())
}

/// Reads a request; returns its path and its body.
fn request(stream: &mut TcpStream) -> Option<(String, String)> {
    let mut reader = BufReader::new(stream);
    let mut line = String::new();
    reader.read_line(&mut line).ok()?;
    let path = line.split(' ').nth(1)?.to_owned();
    let mut length = 0;
    loop {
        let mut header = String::new();
        reader.read_line(&mut header).ok()?;
        let Some((name, value)) = header.trim().split_once(':') else {
            break;
        };
        if name.eq_ignore_ascii_case("content-length") {
            length = value.trim().parse().ok()?;
        }
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body).ok()?;
    Some((path, String::from_utf8(body).ok()?))
}

#[test]
fn chromium_compiles_every_shader() {
    let Some(program) = program() else {
        println!("no Chromium: skipped");
        return;
    };
    let text = |name: &str, source: String| serde_json::json!({ "name": name, "source": source });
    // The first is refused, or findings would not arrive.
    let mut shaders = vec![text("refused", "const beyond: f32 = 3.4028235e38;".into())];
    shaders.extend(
        Shader::all()
            .iter()
            .map(|shader| text(&shader.name, shader.source())),
    );
    let shaders = serde_json::to_string(&shaders).unwrap();
    // Pipelines take minutes.
    let is_all = some(vec![false, true], 1).len() > 1;
    let page = PAGE.replace("ALL", if is_all { "true" } else { "false" });
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.set_nonblocking(true).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let _browser = Browser(
        Command::new(program)
            .args(["--headless", "--no-sandbox", "--disable-dev-shm-usage"])
            .args(["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"])
            .arg(format!("--user-data-dir={}", folder.path().display()))
            .arg(format!("http://{}/", listener.local_addr().unwrap()))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap(),
    );
    let begun = Instant::now();
    let mut has_begun = false;
    let found = loop {
        if !has_begun && begun.elapsed() > START {
            println!("Chromium does not start: skipped");
            return;
        }
        assert!(begun.elapsed() < LIMIT, "no answer from the browser");
        let Ok((mut stream, _)) = listener.accept() else {
            std::thread::sleep(Duration::from_millis(20));
            continue;
        };
        stream.set_nonblocking(false).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(10)))
            .unwrap();
        let Some((path, body)) = request(&mut stream) else {
            continue;
        };
        let (kind, answer) = match path.as_str() {
            "/" => ("text/html", &page),
            "/shaders" => ("application/json", &shaders),
            _ => ("text/plain", &String::new()),
        };
        let length = answer.len();
        let head = format!(
            "HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
        );
        let _ = stream
            .write_all(head.as_bytes())
            .and_then(|()| stream.write_all(answer.as_bytes()));
        has_begun = true;
        if path == "/found" {
            break body;
        }
    };
    let found: Vec<String> = serde_json::from_str(&found).unwrap();
    if found == ["no adapter"] {
        println!("Chromium has no adapter here: skipped");
        return;
    }
    println!("Chromium: {:.1} s", begun.elapsed().as_secs_f64());
    assert!(found[0].starts_with("refused: error"), "{}", found[0]);
    assert!(found.len() == 1, "{}", found[1..].join("\n"));
}
