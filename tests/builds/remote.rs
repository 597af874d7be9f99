//! A store that machines share: what it saves, and what it cannot spoil. With a real server where one is installed
//! (`s3s-fs`), and with servers that misbehave in every way that we thought of.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::project::{Project, Said, said};
use crate::workshop::{Surface, project, ran};

const SMALL: Surface = Surface { levels: "[8]", ..Surface::PLAIN };

/// A build with a remote store and credentials.
fn build_with(project: &Project, url: &str, arguments: &[&str]) -> Said {
    let fixed = ["build", "-q", "--explain", "--json", "--remote", url];
    let mut command = project.command(&[&fixed, arguments].concat());
    for proxy in ["HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "http_proxy", "https_proxy", "all_proxy"] {
        command.env_remove(proxy);
    }
    command.env("AWS_ACCESS_KEY_ID", "bark").env("AWS_SECRET_ACCESS_KEY", "gravel").env_remove("AWS_SESSION_TOKEN");
    said(command.output().unwrap())
}

/// The asset as built without any remote store.
fn wanted() -> Vec<(String, Vec<u8>)> {
    let project = project(&SMALL);
    crate::workshop::build(&project, &[]);
    project.tree("lod/waves")
}

/// A server that answers every request by `answer`, on a port of its own, until the test ends.
fn serve(answer: impl Fn(&str, &mut TcpStream) + Send + Sync + 'static) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/lod", listener.local_addr().unwrap());
    let answer = std::sync::Arc::new(answer);
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let answer = std::sync::Arc::clone(&answer);
            std::thread::spawn(move || {
                let mut stream = stream;
                let head = read_head(&mut stream);
                answer(&head, &mut stream);
            });
        }
    });
    url
}

/// The head of a request; its body, if it has one, is read and forgotten.
fn read_head(stream: &mut TcpStream) -> String {
    let (mut head, mut byte) = (Vec::new(), [0]);
    while !head.ends_with(b"\r\n\r\n") && stream.read(&mut byte).is_ok_and(|n| n == 1) {
        head.push(byte[0]);
    }
    let head = String::from_utf8(head).unwrap().to_lowercase();
    let length = head.lines().find_map(|line| line.strip_prefix("content-length: ")?.trim().parse().ok());
    let _ = stream.read_exact(&mut vec![0; length.unwrap_or(0)]);
    head
}

fn reply(stream: &mut TcpStream, status: &str, body: &[u8]) {
    let head = format!("HTTP/1.1 {status}\r\ncontent-length: {}\r\nconnection: close\r\n\r\n", body.len());
    let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body));
}

/// A build against a bad server: it succeeds with the right bytes, and says what `complaint` does.
fn assert_survived(url: &str, complaint: &str) {
    let project = project(&SMALL);
    let said = build_with(&project, url, &[]);
    assert_eq!(said.code, 0, "{said:?}");
    assert!(said.stderr.contains(complaint), "{said:?}");
    assert!(said.stderr.lines().count() < 60, "it is said once, not for every action: {said:?}");
    assert_eq!(project.tree("lod/waves"), wanted());
    assert_eq!(project.run(&["cache", "verify"]).code, 0);
}

#[test]
fn a_remote_store_that_is_down_is_told_of_once() {
    // A port that was free a moment ago.
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    assert_survived(&format!("http://127.0.0.1:{port}/lod"), "it is not used any more in this build");
}

#[test]
fn a_remote_store_that_takes_ten_seconds_is_left_alone() {
    let url = serve(|_, stream| {
        std::thread::sleep(Duration::from_secs(10));
        reply(stream, "404 Not Found", b"");
    });
    let start = Instant::now();
    assert_survived(&url, "timeout");
    assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
}

#[test]
fn a_remote_store_that_answers_500_is_left_alone() {
    assert_survived(&serve(|_, stream| reply(stream, "500 Internal Server Error", b"no")), "answers 500");
}

#[test]
fn a_remote_store_that_refuses_credentials_is_left_alone_at_once() {
    assert_survived(&serve(|_, stream| reply(stream, "403 Forbidden", b"no")), "check `AWS_ACCESS_KEY_ID`");
}

#[test]
fn bodies_that_break_off_are_not_used() {
    let url = serve(|_, stream| {
        let _ = stream.write_all(b"HTTP/1.1 200 OK\r\ncontent-length: 1000\r\n\r\nthis is not all");
    });
    assert_survived(&url, "it is not used any more in this build");
}

#[test]
fn answers_that_are_lies_are_not_used() {
    // Everything is there, and everything is something else.
    assert_survived(&serve(|_, stream| reply(stream, "200 OK", b"a lie")), "is damaged; it is not used");
}

#[test]
fn bodies_that_do_not_end_are_not_used() {
    let url = serve(|_, stream| {
        let _ = stream.write_all(b"HTTP/1.1 200 OK\r\nconnection: close\r\n\r\n");
        while stream.write_all(&[b'x'; 1 << 16]).is_ok() {}
    });
    assert_survived(&url, "is damaged; it is not used");
}

#[test]
fn passing_failures_are_tried_again() {
    let count = std::sync::atomic::AtomicUsize::new(0);
    let url = serve(move |_, stream| match count.fetch_add(1, std::sync::atomic::Ordering::SeqCst) % 2 {
        0 => reply(stream, "503 Slow Down", b""),
        _ => reply(stream, "404 Not Found", b""),
    });
    let project = project(&SMALL);
    let said = build_with(&project, &url, &[]);
    assert_eq!(said.code, 0);
    // A bucket that takes nothing is the only complaint.
    assert!(said.stderr.contains("is there such a bucket?") && !said.stderr.contains("503"), "{said:?}");
}

#[test]
fn a_url_that_is_none_is_a_mistake_of_the_command_line() {
    let project = project(&SMALL);
    let said = build_with(&project, "lod", &[]);
    assert_eq!(said.code, 2);
    assert!(said.stderr.starts_with("error: `--remote`: `lod` is no remote store; wanted `s3://"), "{said:?}");
}

/// A real server on a folder.
struct Server {
    child: Child,
    url: String,
    folder: PathBuf,
}

impl Server {
    /// Starts `s3s-fs` with a bucket `lod`; it must be installed: `cargo install s3s-fs --version 0.14.1 --features binary`.
    fn start(folder: &Path) -> Self {
        std::fs::create_dir_all(folder.join("lod")).unwrap();
        let binary = std::env::var("S3S_FS").unwrap_or_else(|_| "s3s-fs".into());
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut command = Command::new(binary);
        command.args([
            "--host",
            "127.0.0.1",
            "--port",
            &port.to_string(),
            "--access-key",
            "bark",
            "--secret-key",
            "gravel",
        ]);
        let child =
            command.arg(folder).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("s3s-fs is installed");
        let start = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(start.elapsed() < Duration::from_secs(20), "the server answers");
            std::thread::sleep(Duration::from_millis(20));
        }
        Self { child, url: format!("http://127.0.0.1:{port}/lod/cache"), folder: folder.join("lod/cache") }
    }

    /// Files below the folder of the store, `records` or `artifacts`.
    fn files(&self, kind: &str) -> Vec<PathBuf> {
        let shards = std::fs::read_dir(self.folder.join(kind)).unwrap();
        let mut files: Vec<PathBuf> = shards
            .flat_map(|shard| std::fs::read_dir(shard.unwrap().path()).unwrap())
            .map(|file| file.unwrap().path())
            .collect();
        files.sort();
        files
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

#[test]
#[ignore = "10 s; needs s3s-fs"]
fn a_second_machine_builds_without_computing_anything() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path());
    let [first, second] = [project(&SMALL), project(&SMALL)];
    let said = build_with(&first, &server.url, &[]);
    assert_eq!((said.code, said.stderr.as_str(), ran(&said).len()), (0, "", 10));
    let said = build_with(&second, &server.url, &[]);
    assert_eq!((said.code, said.stderr.as_str(), ran(&said).len()), (0, "", 0));
    assert_eq!(first.tree("lod/waves"), second.tree("lod/waves"));
    // What it fetched it keeps: the server is not needed for another folder.
    drop(server);
    let said = crate::workshop::build(&second, &["--out", "other"]);
    assert_eq!(ran(&said), Vec::<String>::new());
    assert_eq!(first.tree("lod/waves"), second.tree("other/waves"));
}

#[test]
#[ignore = "5 s; needs s3s-fs"]
fn a_second_machine_compiles_no_volume() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path());
    let [first, second] = [(); 2].map(|()| crate::volumes::project("1"));
    let said = build_with(&first, &server.url, &[]);
    assert_eq!((said.code, said.stderr.as_str(), ran(&said).len()), (0, "", 1));
    let said = build_with(&second, &server.url, &[]);
    assert_eq!((said.code, said.stderr.as_str(), ran(&said).len()), (0, "", 0));
    assert_eq!(first.tree("lod/slab"), second.tree("lod/slab"));
}

#[test]
#[ignore = "10 s; needs s3s-fs"]
fn a_second_machine_computes_what_differs_alone() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path());
    let first = project(&SMALL);
    assert_eq!(build_with(&first, &server.url, &[]).code, 0);
    let second = project(&Surface { rank: 2, ..SMALL });
    let ran = ran(&build_with(&second, &server.url, &[]));
    // Decoding is not shared, for the map is at hand.
    assert!(
        !ran.iter().any(|action| ["lobes", "fine", "coarse", "smooth"].iter().any(|stage| action.ends_with(stage))),
        "{ran:?}"
    );
    assert!(ran.contains(&"level 1 fit".to_string()), "{ran:?}");
}

#[test]
#[ignore = "20 s; needs s3s-fs"]
fn a_server_with_damaged_files_poisons_nothing_and_is_mended() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path());
    let first = project(&SMALL);
    assert_eq!(build_with(&first, &server.url, &[]).code, 0);
    for kind in ["artifacts", "records"] {
        for file in server.files(kind) {
            let mut bytes = std::fs::read(&file).unwrap();
            let at = bytes.len() / 2;
            bytes[at] ^= 1;
            std::fs::write(&file, bytes).unwrap();
        }
        let second = project(&SMALL);
        let said = build_with(&second, &server.url, &[]);
        assert_eq!(said.code, 0, "{said:?}");
        assert!(said.stderr.contains("it is not used"), "{said:?}");
        assert_eq!(second.tree("lod/waves"), first.tree("lod/waves"));
        assert_eq!(second.run(&["cache", "verify"]).code, 0);
        // What was found damaged was written anew; a third machine computes nothing.
        let third = project(&SMALL);
        let said = build_with(&third, &server.url, &[]);
        assert_eq!((said.code, ran(&said).len()), (0, 0), "{kind}: {said:?}");
    }
}

#[test]
#[ignore = "5 s; needs s3s-fs"]
fn wrong_credentials_are_told_of_and_end_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path());
    let project = project(&SMALL);
    let mut command = project.command(&["build", "-q", "--remote", &server.url]);
    let said = said(command.env("AWS_ACCESS_KEY_ID", "bark").env("AWS_SECRET_ACCESS_KEY", "wrong").output().unwrap());
    assert_eq!(said.code, 0, "{said:?}");
    assert!(said.stderr.contains("check `AWS_ACCESS_KEY_ID`"), "{said:?}");
}
