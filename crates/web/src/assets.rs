//! The page: files of the folder `assets`, in the program itself.
//!
//! Debug builds read them from the folder, so that a page can be worked on without building.

use axum::body::Body;
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use rust_embed::RustEmbed;

use crate::problem::Problem;

const FONT: &str = "font/woff2";

#[derive(RustEmbed)]
#[folder = "assets"]
struct Assets;

/// `GET` of whatever is no endpoint: a file, or 404.
pub(crate) fn serve(uri: &Uri, headers: &HeaderMap) -> Response {
    let path = match uri.path() {
        "/" => "index.html",
        path => path.strip_prefix("/").unwrap_or(path),
    };
    let Some(file) = Assets::get(path) else {
        return Problem::new(
            StatusCode::NOT_FOUND,
            format!("there is no {:?}; GET /api/openapi.json lists what there is", shortened(uri.path())),
        )
        .into_response();
    };
    let tag = tag(file.metadata.sha256_hash());
    let known = headers.get(header::IF_NONE_MATCH).and_then(|value| value.to_str().ok());
    let common = [
        (header::ETAG, tag.clone()),
        (header::CACHE_CONTROL, "no-cache".to_owned()),
        (header::CONTENT_TYPE, media_type(path).to_owned()),
    ];
    if known.is_some_and(|known| known.split(',').any(|known| known.trim() == tag)) {
        return (StatusCode::NOT_MODIFIED, common).into_response();
    }
    let mut response = (common, Body::from(file.data.into_owned())).into_response();
    if media_type(path) == FONT {
        // Its name changes with its content.
        let value = HeaderValue::from_static("max-age=3600");
        response.headers_mut().insert(header::CACHE_CONTROL, value);
    }
    response
}

fn tag(hash: [u8; 32]) -> String {
    let number = hash.iter().take(8).fold(0_u64, |number, octet| number << 8 | u64::from(*octet));
    format!("\"{number:016x}\"")
}

pub(crate) fn shortened(text: &str) -> String {
    text.chars().take(60).collect()
}

fn media_type(path: &str) -> &'static str {
    match path.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("png") => "image/png",
        Some("woff2") => FONT,
        Some("json" | "map") => "application/json",
        _ => "text/plain; charset=utf-8",
    }
}
