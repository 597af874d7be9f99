//! A store that machines share: objects of a bucket, by the S3 protocol.
//!
//! Three requests are all it needs: GET, HEAD, PUT. Names follow from content, so two writers of one name write the same
//! bytes and no request has to be conditional; a server that ignores conditions is as good as any. Nothing that comes
//! back is believed: the caller holds it against its digest. Every request has a time limit; what fails is tried again,
//! and a server that goes on failing is left alone for the rest of the build.

use std::collections::BTreeSet;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rusty_s3::{Bucket, Credentials, S3Action, UrlStyle};
use ureq::http::Response;
use ureq::{Agent, Body};

/// Tries of a request, and the pauses between them.
const PAUSES: [Duration; 2] = [Duration::from_millis(100), Duration::from_millis(500)];

/// Failed tries in a row after which the server is left alone.
const PATIENCE: u32 = 3;

/// Time for a request without a body, and for the first byte of one with it.
const LATENCY: Duration = Duration::from_secs(4);

/// Bytes a second that a body may be expected to come with, at least.
const SLOWEST: u64 = 1 << 20;

/// How long a signature is good for.
const SIGNED_FOR: Duration = Duration::from_secs(600);

/// Where AWS is, when the URL does not tell: `us-east-1` is what every tool assumes.
const DEFAULT_REGION: &str = "us-east-1";

/// A bucket, or a folder of one.
#[derive(Debug)]
pub struct Remote {
    bucket: Bucket,
    prefix: String,
    credentials: Option<Credentials>,
    agent: Agent,
    url: String,
    health: Mutex<Health>,
}

/// How it went so far.
#[derive(Debug, Default)]
struct Health {
    failures: u32,
    is_given_up: bool,
    complaints: Vec<String>,
    /// Names whose content was not what it should be: they are written anew.
    distrusted: BTreeSet<String>,
}

/// A request that came to nothing; why is among the complaints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the remote store does not answer")]
pub struct RemoteError;

impl Remote {
    /// The store at `url`: `s3://BUCKET/FOLDER` for AWS, or `http[s]://HOST[:PORT]/BUCKET/FOLDER`.
    ///
    /// Credentials and region are those of the environment, as every S3 tool takes them: `AWS_ACCESS_KEY_ID`,
    /// `AWS_SECRET_ACCESS_KEY`, `AWS_SESSION_TOKEN`, `AWS_REGION`. Without credentials requests are not signed.
    pub fn from_environment(url: &str) -> Result<Self, String> {
        let wanted =
            || format!("`{url}` is no remote store; wanted `s3://BUCKET/FOLDER` or `http[s]://HOST/BUCKET/FOLDER`");
        let region = std::env::var("AWS_REGION").unwrap_or_else(|_| DEFAULT_REGION.into());
        let (scheme, rest) = url.split_once("://").ok_or_else(wanted)?;
        let (endpoint, path) = match scheme {
            "s3" => (format!("https://s3.{region}.amazonaws.com"), rest),
            "http" | "https" => {
                let (host, path) = rest.split_once('/').ok_or_else(wanted)?;
                (format!("{scheme}://{host}"), path)
            }
            _ => return Err(wanted()),
        };
        let (name, folder) = path.split_once('/').unwrap_or((path, ""));
        let folder = folder.trim_matches('/');
        if name.is_empty() || folder.split('/').any(|part| part == "." || part == "..") {
            return Err(wanted());
        }
        let endpoint = endpoint.parse().map_err(|_| wanted())?;
        let bucket = Bucket::new(endpoint, UrlStyle::Path, name.to_owned(), region).map_err(|_| wanted())?;
        let config = Agent::config_builder().http_status_as_error(false).timeout_connect(Some(LATENCY));
        Ok(Self {
            bucket,
            prefix: if folder.is_empty() { String::new() } else { format!("{folder}/") },
            credentials: Credentials::from_env(),
            agent: config.build().new_agent(),
            url: url.into(),
            health: Mutex::default(),
        })
    }

    /// The object `name`, of at most `most` bytes; `None` where there is none.
    pub(super) fn get(&self, name: &str, most: u64) -> Result<Option<Vec<u8>>, RemoteError> {
        let object = self.object(name);
        self.tried(|| {
            let url = self.bucket.get_object(self.credentials.as_ref(), &object).sign(SIGNED_FOR);
            let request = self.agent.get(url.as_str()).config().timeout_global(Some(time_for(most))).build();
            let mut response = request.call()?;
            match response.status().as_u16() {
                200 => match response.body_mut().with_config().limit(most + 1).read_to_vec() {
                    // More than there can be: as wrong as anything else that has another digest.
                    Err(ureq::Error::BodyExceedsLimit(_)) => Ok(Some(Vec::new())),
                    body => Ok(Some(body?)),
                },
                404 => Ok(None),
                _ => Err(Fault::of(&response)),
            }
        })
    }

    /// Writes the object `name`, unless it is there and not distrusted.
    pub(super) fn put(&self, name: &str, bytes: &[u8]) -> Result<(), RemoteError> {
        let is_distrusted = self.health().distrusted.contains(name);
        let object = self.object(name);
        let limit = Some(time_for(bytes.len() as u64));
        if !is_distrusted && self.has(&object)? {
            return Ok(());
        }
        self.tried(|| {
            let url = self.bucket.put_object(self.credentials.as_ref(), &object).sign(SIGNED_FOR);
            let response = self.agent.put(url.as_str()).config().timeout_global(limit).build().send(bytes)?;
            if response.status().is_success() { Ok(()) } else { Err(Fault::of(&response)) }
        })?;
        self.health().distrusted.remove(name);
        Ok(())
    }

    fn has(&self, object: &str) -> Result<bool, RemoteError> {
        self.tried(|| {
            let url = self.bucket.head_object(self.credentials.as_ref(), object).sign(SIGNED_FOR);
            let response = self.agent.head(url.as_str()).config().timeout_global(Some(LATENCY)).build().call()?;
            match response.status().as_u16() {
                200 => Ok(true),
                404 => Ok(false),
                _ => Err(Fault::of(&response)),
            }
        })
    }

    /// Notes that the content of `name` is wrong: it is written anew when there is something right to write.
    pub(super) fn distrust(&self, name: &str) {
        self.health().distrusted.insert(name.into());
    }

    /// What went wrong since this was last asked, one line each.
    pub(super) fn take_complaints(&self) -> Vec<String> {
        std::mem::take(&mut self.health().complaints)
    }

    /// Tries a request until it succeeds, is refused, or patience is at its end.
    fn tried<T>(&self, request: impl Fn() -> Result<T, Fault>) -> Result<T, RemoteError> {
        for pause in PAUSES.iter().map(Some).chain([None]) {
            if self.health().is_given_up {
                return Err(RemoteError);
            }
            match request() {
                Ok(value) => {
                    self.health().failures = 0;
                    return Ok(value);
                }
                Err(fault) => self.failed(&fault),
            }
            if let Some(pause) = pause.filter(|_| !self.health().is_given_up) {
                std::thread::sleep(*pause);
            }
        }
        Err(RemoteError)
    }

    /// Counts a failed try.
    fn failed(&self, fault: &Fault) {
        let mut health = self.health();
        health.failures += 1;
        if !health.is_given_up && (fault.is_final || health.failures >= PATIENCE) {
            health.is_given_up = true;
            let text = format!("remote store `{}`: {}; it is not used any more in this build", self.url, fault.text);
            health.complaints.push(text);
        }
    }

    fn object(&self, name: &str) -> String {
        format!("{}{name}", self.prefix)
    }

    fn health(&self) -> MutexGuard<'_, Health> {
        self.health.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A try that failed.
struct Fault {
    text: String,
    /// Whether another try would end alike.
    is_final: bool,
}

impl Fault {
    /// A status that is no answer: 5xx and 429 pass, others do not.
    fn of(response: &Response<Body>) -> Self {
        let status = response.status();
        let hint = match status.as_u16() {
            401 | 403 => " (check `AWS_ACCESS_KEY_ID` and `AWS_SECRET_ACCESS_KEY`)",
            404 => " (is there such a bucket?)",
            _ => "",
        };
        let is_final = !status.is_server_error() && status.as_u16() != 429;
        Self { text: format!("answers {status}{hint}"), is_final }
    }
}

impl From<ureq::Error> for Fault {
    fn from(error: ureq::Error) -> Self {
        Self { text: error.to_string(), is_final: false }
    }
}

/// The time that a request with so many bytes may take.
fn time_for(bytes: u64) -> Duration {
    LATENCY + Duration::from_secs(bytes / SLOWEST)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_name_a_host_a_bucket_and_a_folder() {
        let place = |url: &str| {
            let remote = Remote::from_environment(url).unwrap();
            remote.bucket.object_url(&remote.object("records/ab/abc")).to_string()
        };
        assert_eq!(place("http://127.0.0.1:9000/lod"), "http://127.0.0.1:9000/lod/records/ab/abc");
        assert_eq!(place("https://store.example/lod/a/b/"), "https://store.example/lod/a/b/records/ab/abc");
        assert!(place("s3://lod/cache").ends_with(".amazonaws.com/lod/cache/records/ab/abc"));
        for url in ["lod", "ftp://host/lod", "http://host", "http://host/", "s3://", "s3://lod/../x", "http:///lod"] {
            assert!(Remote::from_environment(url).is_err(), "{url}");
        }
    }
}
