//! The local web server: access and addresses.
//!
//! Access has three barriers: the server listens on the loopback only; every address begins with a
//! secret that is printed once; and a request must name this server (`Host`) and come from its own
//! page (`Origin`), so that no other page in the browser can reach the muscle.

use super::page;
use super::results::Outcome;
use super::shared::Shared;
use super::socket;
use super::uploads::LARGEST;
use http_body_util::{BodyExt, Full, LengthLimitError, Limited};
use hyper::body::{Body, Bytes, Incoming};
use hyper::header::{
    ALLOW, CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, HeaderMap, HeaderName,
    HeaderValue, LOCATION, ORIGIN, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS,
};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::fmt;
use std::io;
use std::net::{Ipv4Addr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use thermyo_files::units;
use tokio::task::AbortHandle;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::handshake::server::create_response_with_body;
use tokio_tungstenite::tungstenite::protocol::{Role, WebSocketConfig};

type Response = hyper::Response<Full<Bytes>>;

/// Longest message of a page, including a scenario's text.
const LONGEST_MESSAGE: usize = 1 << 18;
/// Largest number of connections that have not sent the secret yet: a browser opens six.
const MOST_STRANGERS: usize = 64;
/// Time limit for the headers of a request, and for an idle connection.
const HEADERS: Duration = Duration::from_secs(10);
/// Interval at which the server's end is checked.
const LOOK: Duration = Duration::from_millis(50);
/// Time for the last messages to the pages.
const FAREWELL: Duration = Duration::from_millis(200);

/// The page loads from this server only, and runs only its own script.
const PAGE_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
                           img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// A report contains its script and style, and loads nothing, not even from this server.
const REPORT_POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; \
                             img-src data:; sandbox allow-scripts allow-downloads; frame-ancestors 'none'";

const PLAIN: &str = "text/plain; charset=utf-8";

#[derive(Debug, Clone)]
pub struct Address {
    port: u16,
    token: String,
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "http://127.0.0.1:{}/{}/", self.port, self.token)
    }
}

/// Listens on the loopback, at the given port or a free one, with a new secret.
pub fn listen(port: Option<u16>) -> io::Result<(TcpListener, Address)> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port.unwrap_or(0)))?;
    listener.set_nonblocking(true)?;
    let mut secret = [0; 16];
    getrandom::fill(&mut secret).map_err(|error| io::Error::other(error.to_string()))?;
    let token = secret.iter().map(|byte| format!("{byte:02x}")).collect();
    let port = listener.local_addr()?.port();
    Ok((listener, Address { port, token }))
}

/// State of every request.
#[derive(Clone)]
struct Site {
    address: Arc<Address>,
    shared: Arc<Shared>,
}

pub(super) fn run(listener: TcpListener, address: Address, shared: Arc<Shared>) -> io::Result<()> {
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
    let ending = Arc::clone(&shared);
    let site = Site { address: Arc::new(address), shared };
    runtime.block_on(async move {
        let listener = tokio::net::TcpListener::from_std(listener)?;
        tokio::select! {
            () = accept(listener, site) => Ok(()),
            () = ended(&ending) => Ok(()),
        }
    })
}

/// Whether a request of the connection has sent the secret.
#[derive(Debug, Clone, Default)]
struct Known(Arc<AtomicBool>);

/// Serves every connection. If too many have not sent the secret, the oldest of them is closed, so
/// that the page and a recording's files never run out of descriptors.
async fn accept(listener: tokio::net::TcpListener, site: Site) {
    let mut strangers: VecDeque<(Known, AbortHandle)> = VecDeque::new();
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // Descriptors are exhausted for a while.
            tokio::time::sleep(LOOK).await;
            continue;
        };
        // Frames are small, and none waits for the acknowledgement of the one before.
        let _ = stream.set_nodelay(true);
        let known = Known::default();
        let (site, entered) = (site.clone(), known.clone());
        let service = service_fn(move |request| {
            let (site, entered) = (site.clone(), entered.clone());
            async move { Ok::<_, Infallible>(door(site, &entered, request).await) }
        });
        let mut http = http1::Builder::new();
        http.timer(TokioTimer::new()).header_read_timeout(HEADERS);
        let connection = http.serve_connection(TokioIo::new(stream), service).with_upgrades();
        let serving = tokio::spawn(async move { drop(connection.await) });
        strangers
            .retain(|(known, serving)| !known.0.load(Ordering::Relaxed) && !serving.is_finished());
        strangers.push_back((known, serving.abort_handle()));
        if strangers.len() > MOST_STRANGERS
            && let Some((_, oldest)) = strangers.pop_front()
        {
            oldest.abort();
        }
    }
}

async fn ended(shared: &Shared) {
    while !shared.ended() {
        tokio::time::sleep(LOOK).await;
    }
    tokio::time::sleep(FAREWELL).await;
}

/// Checks access, and adds the security headers.
async fn door(site: Site, known: &Known, request: Request<Incoming>) -> Response {
    if let Err(why) = may_enter(&site.address, request.uri().path(), request.headers()) {
        return answer(StatusCode::FORBIDDEN, PLAIN, format!("{why}\n"));
    }
    known.0.store(true, Ordering::Relaxed);
    let mut response = route(site, request).await;
    let headers = response.headers_mut();
    let fixed = |text| HeaderValue::from_static(text);
    headers.insert(REFERRER_POLICY, fixed("no-referrer"));
    headers.insert(X_CONTENT_TYPE_OPTIONS, fixed("nosniff"));
    headers.insert(X_FRAME_OPTIONS, fixed("DENY"));
    headers.insert(CACHE_CONTROL, fixed("no-store"));
    headers.insert(HeaderName::from_static("cross-origin-opener-policy"), fixed("same-origin"));
    headers.entry(CONTENT_SECURITY_POLICY).or_insert(fixed(PAGE_POLICY));
    response
}

/// Routes a request, whose path begins with the secret.
async fn route(site: Site, request: Request<Incoming>) -> Response {
    let path = request.uri().path().to_owned();
    let parts: Vec<&str> = path.split('/').skip(2).collect();
    if request.method() == Method::POST && parts[..] == ["files"] {
        return keep(&site, request).await;
    }
    if ![Method::GET, Method::HEAD].contains(request.method()) {
        let allowed = if parts[..] == ["files"] { "POST" } else { "GET, HEAD" };
        let text = format!("{}: must be {allowed} here\n", request.method());
        let mut response = answer(StatusCode::METHOD_NOT_ALLOWED, PLAIN, text);
        response.headers_mut().insert(ALLOW, HeaderValue::from_static(allowed));
        return response;
    }
    match parts[..] {
        [] => {
            let mut response = answer(StatusCode::PERMANENT_REDIRECT, PLAIN, "");
            let whole = HeaderValue::from_str(&format!("{path}/"));
            response.headers_mut().insert(LOCATION, whole.expect("a path is a header's value"));
            response
        }
        [""] => answer(StatusCode::OK, "text/html; charset=utf-8", site.shared.kind.page()),
        ["live"] => live(site, request),
        [name] => file(name),
        ["results", name, file] => result(&site, name, file).await,
        _ => not_found(),
    }
}

fn not_found() -> Response {
    answer(StatusCode::NOT_FOUND, PLAIN, "there is no such page\n")
}

fn answer(status: StatusCode, kind: &'static str, text: impl Into<Bytes>) -> Response {
    let mut response = Response::new(Full::new(text.into()));
    *response.status_mut() = status;
    response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    response
}

fn may_enter(address: &Address, path: &str, headers: &HeaderMap) -> Result<(), &'static str> {
    let names = ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", address.port));
    if [HOST, ORIGIN].iter().any(|name| headers.get_all(name).iter().count() > 1) {
        return Err("a request has one Host header and one Origin header");
    }
    let text = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or_default());
    if !text(HOST).is_some_and(|host| names.iter().any(|name| name == host)) {
        return Err("this server goes by another name: open the address that it has printed");
    }
    let own = |origin: &str| names.iter().any(|name| origin.strip_prefix("http://") == Some(name));
    if text(ORIGIN).is_some_and(|origin| !own(origin)) {
        return Err("only the server's own page may ask this");
    }
    let token = path.trim_start_matches('/').split('/').next().unwrap_or_default();
    if !same(token.as_bytes(), address.token.as_bytes()) {
        return Err(
            "the address is not the one that the server has printed: its secret part is wrong",
        );
    }
    Ok(())
}

/// Compares in constant time, so that it does not reveal how many bytes are right.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |differ, (a, b)| differ | (a ^ b)) == 0
}

fn file(name: &str) -> Response {
    let text = match name {
        "palette.js" => Some(page::colours()),
        "units.js" => Some(units::script(&["Pa", "K", "m", "", "kg/s", "s", "rad", "N m/rad"])),
        _ => {
            let mut files = page::FILES.iter().chain(&page::OWN_FILES);
            files.find(|(known, _)| *known == name).map(|(_, text)| (*text).to_owned())
        }
    };
    let kind = if name.ends_with(".css") {
        "text/css; charset=utf-8"
    } else {
        "text/javascript; charset=utf-8"
    };
    match text {
        Some(text) => answer(StatusCode::OK, kind, text),
        None => not_found(),
    }
}

/// Keeps a file that the page sends; the answer is its number.
async fn keep(site: &Site, request: Request<Incoming>) -> Response {
    let stated = request.body().size_hint().lower();
    if stated <= LARGEST as u64 {
        // A body without a stated length is read up to the limit.
        match Limited::new(request.into_body(), LARGEST).collect().await {
            Ok(body) => {
                let number = site.shared.uploads.put(body.to_bytes());
                return answer(StatusCode::OK, PLAIN, number.to_string());
            }
            Err(error) if !error.is::<LengthLimitError>() => {
                return answer(StatusCode::BAD_REQUEST, PLAIN, "the file did not arrive whole\n");
            }
            Err(_) => (),
        }
    }
    let text = format!(
        "a file for this page may have {} MiB; the command takes larger ones\n",
        LARGEST >> 20
    );
    answer(StatusCode::PAYLOAD_TOO_LARGE, PLAIN, text)
}

async fn result(site: &Site, name: &str, file: &str) -> Response {
    let results = site.shared.results();
    let found = results.iter().find(|outcome| outcome.name == name);
    let Some((path, kind)) = found.and_then(|outcome| Outcome::file(outcome, file)) else {
        return not_found();
    };
    // A trace of an hour is large, so it is read on a blocking thread.
    let text = tokio::task::spawn_blocking(move || std::fs::read(path)).await;
    let Ok(Ok(text)) = text else {
        return answer(StatusCode::NOT_FOUND, PLAIN, "it is no longer where it was\n");
    };
    let mut response = answer(StatusCode::OK, kind, text);
    let policy = HeaderValue::from_static(REPORT_POLICY);
    response.headers_mut().insert(CONTENT_SECURITY_POLICY, policy);
    response
}

/// The websocket of a page.
fn live(site: Site, mut request: Request<Incoming>) -> Response {
    let upgrading = hyper::upgrade::on(&mut request);
    let accepted = match create_response_with_body(&request, Full::default) {
        Ok(accepted) => accepted,
        Err(error) => return answer(StatusCode::BAD_REQUEST, PLAIN, format!("{error}\n")),
    };
    tokio::spawn(async move {
        let Ok(upgraded) = upgrading.await else { return };
        let limits = WebSocketConfig::default().max_message_size(Some(LONGEST_MESSAGE));
        let stream = TokioIo::new(upgraded);
        let socket = WebSocketStream::from_raw_socket(stream, Role::Server, Some(limits)).await;
        socket::run(socket, site.shared).await;
    });
    accepted
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::net::TcpStream;

    #[test]
    fn only_the_page_of_this_server_may_enter() {
        let address = Address { port: 4711, token: "0123abcd".to_owned() };
        let enters = |path: &str, host: Option<&str>, origin: Option<&str>| {
            let mut headers = HeaderMap::new();
            for (name, value) in [(HOST, host), (ORIGIN, origin)] {
                if let Some(value) = value {
                    headers.insert(name, value.parse().unwrap());
                }
            }
            may_enter(&address, path, &headers).is_ok()
        };
        let (here, path) = (Some("127.0.0.1:4711"), "/0123abcd/live");
        assert!(enters(path, here, None) && enters("/0123abcd", here, None));
        assert!(enters(path, Some("localhost:4711"), Some("http://localhost:4711")));
        for (what, path, host, origin) in [
            ("no secret", "/", here, None),
            ("another secret", "/0123abce/live", here, None),
            ("part of the secret", "/0123abc/live", here, None),
            ("no name", path, None, None),
            ("a name that was bent to this address", path, Some("evil.example:4711"), None),
            ("another port", path, Some("127.0.0.1:4712"), None),
            ("another page", path, here, Some("http://evil.example")),
            ("another server's page here", path, here, Some("http://127.0.0.1:4712")),
            ("a file or a sandbox", path, here, Some("null")),
        ] {
            assert!(!enters(path, host, origin), "{what}");
        }
        for name in [HOST, ORIGIN] {
            let mut headers = HeaderMap::new();
            headers.insert(HOST, "127.0.0.1:4711".parse().unwrap());
            headers.insert(ORIGIN, "http://127.0.0.1:4711".parse().unwrap());
            assert!(may_enter(&address, path, &headers).is_ok());
            headers.append(name, "evil.example".parse().unwrap());
            assert!(may_enter(&address, path, &headers).is_err(), "a second one");
        }
    }

    /// A server without a board, which ends when this is dropped.
    struct Serving {
        host: String,
        path: String,
        shared: Arc<Shared>,
        thread: Option<std::thread::JoinHandle<io::Result<()>>>,
    }

    impl Serving {
        fn new() -> Self {
            let (listener, address) = listen(None).unwrap();
            let shared = Arc::new(Shared::default());
            let host = format!("127.0.0.1:{}", address.port);
            let path = format!("/{}/page.js", address.token);
            let thread = Some(std::thread::spawn({
                let shared = Arc::clone(&shared);
                move || run(listener, address, shared)
            }));
            Self { host, path, shared, thread }
        }

        fn connect(&self) -> TcpStream {
            let stream = TcpStream::connect(&self.host).unwrap();
            // A limit against hanging, not a target.
            stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
            stream
        }

        /// The answer to a request of the page with these headers.
        fn page(&self, headers: &str) -> String {
            let mut stream = self.connect();
            write!(stream, "GET {} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n", self.path)
                .unwrap();
            let mut text = String::new();
            stream.read_to_string(&mut text).unwrap();
            text
        }
    }

    impl Drop for Serving {
        fn drop(&mut self) {
            self.shared.end();
            self.thread.take().unwrap().join().unwrap().unwrap();
        }
    }

    #[test]
    fn connections_without_the_secret_make_room() {
        const STRANGERS: usize = 300;
        let serving = Serving::new();
        let mut strangers: Vec<TcpStream> = (0..STRANGERS).map(|_| serving.connect()).collect();
        let text = serving.page(&format!("Host: {}\r\n", serving.host));
        assert!(text.starts_with("HTTP/1.1 200"), "{text}");
        // The page connected last: by now the server has closed all but the latest connections
        // without the secret.
        for stranger in &mut strangers[..=STRANGERS - MOST_STRANGERS] {
            assert!(matches!(stranger.read(&mut [0]), Ok(0)), "it was kept");
        }
    }

    #[test]
    fn a_wrong_method_or_page_is_answered_in_words() {
        let serving = Serving::new();
        let files = serving.path.replace("page.js", "files");
        let other = serving.path.replace("page.js", "other.js");
        for (method, path, status, text) in [
            ("DELETE", &serving.path, "405", "DELETE: must be GET, HEAD here"),
            ("PUT", &files, "405", "PUT: must be POST here"),
            ("GET", &files, "404", "there is no such page"),
            ("GET", &other, "404", "there is no such page"),
        ] {
            let mut stream = serving.connect();
            let host = &serving.host;
            write!(stream, "{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")
                .unwrap();
            let mut answer = String::new();
            stream.read_to_string(&mut answer).unwrap();
            assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{answer}");
            assert!(answer.ends_with(&format!("{text}\n")), "{answer}");
        }
    }

    #[test]
    fn a_request_that_does_not_end_is_closed() {
        let serving = Serving::new();
        let mut half = serving.connect();
        write!(half, "GET {} HTTP/1.1\r\nHost: {}\r\n", serving.path, serving.host).unwrap();
        let mut text = String::new();
        half.read_to_string(&mut text).expect("the server closes it");
        assert!(!text.starts_with("HTTP/1.1 200"), "{text}");
    }

    #[test]
    fn a_second_host_is_refused() {
        let serving = Serving::new();
        let right = format!("Host: {}\r\n", serving.host);
        assert!(serving.page(&right).starts_with("HTTP/1.1 200"));
        let wrong = "Host: evil.example\r\n";
        for headers in [format!("{right}{wrong}"), format!("{wrong}{right}")] {
            let text = serving.page(&headers);
            assert!(text.starts_with("HTTP/1.1 403"), "{text}");
        }
    }
}
