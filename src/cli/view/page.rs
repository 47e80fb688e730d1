//! The page of `beo view --web`: files that are compiled into the program, over HTTP. It answers GET, and nothing else.

use crate::recording::LiveError;
use std::borrow::Cow;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Path, type and content of each file.
const FILES: [(&str, &str, &[u8]); 10] = [
    ("/", "text/html; charset=utf-8", include_bytes!("page/index.html")),
    ("/style.css", "text/css", include_bytes!("page/style.css")),
    ("/main.js", SCRIPT, include_bytes!("page/main.js")),
    ("/connection.js", SCRIPT, include_bytes!("page/connection.js")),
    ("/panels.js", SCRIPT, include_bytes!("page/panels.js")),
    ("/protobuf.js", SCRIPT, include_bytes!("page/protobuf.js")),
    ("/scene.js", SCRIPT, include_bytes!("page/scene.js")),
    ("/three/three.module.min.js", SCRIPT, include_bytes!("page/three/three.module.min.js")),
    ("/three/three.core.min.js", SCRIPT, include_bytes!("page/three/three.core.min.js")),
    ("/three/OrbitControls.js", SCRIPT, include_bytes!("page/three/OrbitControls.js")),
];
const SCRIPT: &str = "text/javascript";

/// Scripts run from these files alone. The hash is that of the import map in `index.html`.
const POLICY: &str = "default-src 'self'; connect-src 'self' ws:; img-src data:; \
                      script-src 'self' 'sha256-29WI3f0lmFBmlTeg84u39lbSwHQ2UZjsAjVN0GFyWBU='";

/// A request is no longer than this, and whoever sends it takes no longer.
const MOST_BYTES: usize = 8192;
const PATIENCE: Duration = Duration::from_secs(5);
/// Requests that are answered at a time; more are turned away.
const MOST_AT_A_TIME: usize = 32;

/// Serves the page from another thread, until the program ends; the page connects to `live_port` of the same host.
///
/// # Errors
/// [`LiveError`] if the address cannot be listened on.
pub fn serve(host: &str, port: u16, live_port: u16) -> Result<SocketAddr, LiveError> {
    let failed = |error| LiveError::listen(format!("{host}:{port}"), error);
    let listener = TcpListener::bind((host, port)).map_err(failed)?;
    let address = listener.local_addr().map_err(failed)?;
    let answer_all = move || {
        let place = Arc::new(());
        for stream in listener.incoming() {
            let Ok(stream) = stream else {
                // Of connections that cannot be taken, for want of descriptors, more may come at once.
                std::thread::sleep(Duration::from_millis(50));
                continue;
            };
            // Each that is being answered holds its place.
            if Arc::strong_count(&place) > MOST_AT_A_TIME {
                continue;
            }
            let held = place.clone();
            let answer = move || {
                // Who does not read the answer, or goes away, does without it.
                let _ = answer(stream, live_port);
                drop(held);
            };
            // Where no thread can be had, the connection is closed.
            let _ = std::thread::Builder::new().name("beo-page".into()).spawn(answer);
        }
    };
    std::thread::Builder::new().name("beo-pages".into()).spawn(answer_all).map_err(failed)?;
    Ok(address)
}

fn answer(mut stream: TcpStream, live_port: u16) -> io::Result<()> {
    stream.set_write_timeout(Some(PATIENCE))?;
    let (status, kind, content) = match read_path(&mut stream)? {
        Ok(path) => content_of(&path, live_port),
        Err(status) => (status, "text/plain", status.as_bytes().into()),
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nContent-Security-Policy: {POLICY}\r\n\
         X-Content-Type-Options: nosniff\r\nCache-Control: no-cache\r\nConnection: close\r\n\r\n",
        content.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(&content)
}

fn content_of(path: &str, live_port: u16) -> (&'static str, &'static str, Cow<'static, [u8]>) {
    if path == "/server.json" {
        return ("200 OK", "application/json", format!("{{\"port\":{live_port}}}").into_bytes().into());
    }
    match FILES.iter().find(|(name, ..)| *name == path) {
        Some(&(_, kind, content)) => ("200 OK", kind, content.into()),
        None => ("404 Not Found", "text/plain", b"there is no such file".as_slice().into()),
    }
}

/// The path that is asked for, without a query, or the status of an answer that refuses.
fn read_path(stream: &mut TcpStream) -> io::Result<Result<String, &'static str>> {
    let (mut request, start) = (Vec::new(), Instant::now());
    loop {
        let left = PATIENCE.saturating_sub(start.elapsed());
        if left.is_zero() || request.len() == MOST_BYTES {
            return Ok(Err("400 Bad Request"));
        }
        stream.set_read_timeout(Some(left))?;
        let mut piece = [0; 1024];
        let room = piece.len().min(MOST_BYTES - request.len());
        match stream.read(&mut piece[..room]) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => request.extend_from_slice(&piece[..count]),
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(error) => return Err(error),
        }
        let mut headers = [httparse::EMPTY_HEADER; 64];
        let mut parsed = httparse::Request::new(&mut headers);
        match (parsed.parse(&request), parsed.method, parsed.path) {
            (Ok(httparse::Status::Partial), ..) => {}
            (Ok(_), Some("GET"), Some(path)) => return Ok(Ok(path.split('?').next().unwrap_or("/").to_owned())),
            (Ok(_), ..) => return Ok(Err("405 Method Not Allowed")),
            (Err(_), ..) => return Ok(Err("400 Bad Request")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(address: SocketAddr, request: &[u8]) -> String {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(request).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        String::from_utf8_lossy(&answer).into_owned()
    }

    #[test]
    fn files_are_served_and_nothing_else() {
        let address = serve("127.0.0.1", 0, 4711).unwrap();
        for (path, kind, content) in FILES {
            let answer = ask(address, format!("GET {path}?again HTTP/1.1\r\nHost: there\r\n\r\n").as_bytes());
            assert!(answer.starts_with("HTTP/1.1 200 OK\r\n") && answer.contains(kind), "{path}");
            assert!(answer.ends_with(&*String::from_utf8_lossy(content)), "{path}");
        }
        assert!(ask(address, b"GET /server.json HTTP/1.1\r\n\r\n").ends_with(r#"{"port":4711}"#));
        for (request, status) in [
            (&b"GET /../etc/passwd HTTP/1.1\r\n\r\n"[..], "404"),
            (&b"POST / HTTP/1.1\r\n\r\n"[..], "405"),
            (&b"\x16\x03\x01\0\0\r\n\r\n"[..], "400"),
            (&[b'a'; MOST_BYTES][..], "400"),
        ] {
            assert!(ask(address, request).starts_with(&format!("HTTP/1.1 {status} ")), "{status}");
        }
        let taken = serve("127.0.0.1", address.port(), 1).unwrap_err().to_string();
        assert!(taken.contains(&format!("cannot listen on {address}: ")) && taken.contains("another program has this port"), "{taken}");
    }

    #[test]
    fn every_file_that_the_page_names_is_served() {
        for (path, kind, content) in FILES.iter().filter(|(path, ..)| !path.contains(".min.")) {
            let text = String::from_utf8_lossy(content);
            let folder = &path[..=path.rfind('/').unwrap()];
            let mut names: Vec<String> = Vec::new();
            for start in ["from \"./", "\": \"./", "href=\"", "src=\""] {
                let named = text.split(start).skip(1).filter_map(|rest| rest.split('"').next());
                names.extend(named.filter(|name| !name.starts_with("data:")).map(|name| format!("{folder}{name}")));
            }
            assert!(*kind != "text/html; charset=utf-8" || names.len() == 3, "{names:?}");
            for name in names {
                assert!(FILES.iter().any(|(known, ..)| *known == name), "{path} names {name}");
            }
        }
    }
}
