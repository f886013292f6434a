//! What the API is, as OpenAPI 3.1: made from the same table that the router is made from.

mod commands;
mod schemas;

use serde_json::{Map, Value, json};

use crate::api::{ENDPOINTS, Endpoint, Gives};
use crate::problem::MEDIA_TYPE;

/// The whole document.
pub fn document() -> Value {
    let mut paths = Map::new();
    for endpoint in ENDPOINTS {
        let path = paths.entry(endpoint.path).or_insert_with(|| json!({}));
        if let Value::Object(path) = path {
            path.insert(endpoint.method.to_lowercase(), operation(endpoint));
        }
    }
    json!({
        "openapi": "3.1.0",
        "info": {
            "title": "SCH108BEX as software",
            "version": env!("CARGO_PKG_VERSION"),
            "description": "The bench of virtual encoders: what there is, what happens, and what can be done. What goes wrong \
                            comes as a problem document (RFC 9457) whose detail says what to do.",
            "license": { "name": "MIT OR Apache-2.0", "identifier": "MIT OR Apache-2.0" },
        },
        "servers": [{ "url": "/" }],
        "paths": paths,
        "components": { "schemas": schemas::all() },
    })
}

fn operation(endpoint: &Endpoint) -> Value {
    let mut operation = json!({
        "operationId": endpoint.id,
        "summary": endpoint.does,
        "responses": responses(endpoint),
    });
    if let Some((schema, required)) = endpoint.takes {
        operation["requestBody"] = json!({
            "required": required,
            "content": { "application/json": { "schema": { "$ref": reference(schema) } } },
        });
    }
    let parameters: Vec<_> = endpoint
        .parameters
        .iter()
        .map(|(place, name, schema, does)| {
            json!({
                "name": name, "in": place, "required": *place == "path", "description": does,
                "schema": { "$ref": reference(schema) },
            })
        })
        .collect();
    if !parameters.is_empty() {
        operation["parameters"] = parameters.into();
    }
    operation
}

fn responses(endpoint: &Endpoint) -> Value {
    let (media, schema) = match endpoint.gives {
        Gives::Json(schema) => ("application/json", json!({ "$ref": reference(schema) })),
        Gives::Events => ("text/event-stream", json!({ "type": "string" })),
        Gives::File => ("application/octet-stream", json!({})),
    };
    let mut responses = Map::new();
    responses.insert(
        "200".to_owned(),
        json!({ "description": endpoint.done, "content": { media: { "schema": schema } } }),
    );
    let always: &[(u16, &str)] = &[
        (401, "the token is missing: the server is open to other computers"),
        (403, "a page of another site asks, or the host is not this server"),
        (503, "too many connections, or the plant does not run any more"),
    ];
    for (status, why) in always.iter().chain(endpoint.refuses) {
        responses.insert(
            status.to_string(),
            json!({
                "description": why,
                "content": { MEDIA_TYPE: { "schema": { "$ref": reference("Problem") } } },
            }),
        );
    }
    Value::Object(responses)
}

fn reference(schema: &str) -> String {
    format!("#/components/schemas/{schema}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The document is kept beside the code, so that a change of the API is seen where changes are read.
    #[test]
    fn the_document_is_the_one_that_is_kept() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/openapi.json");
        let text = format!("{:#}\n", document());
        if std::env::var_os("SCH108BEX_WRITE_OPENAPI").is_some() {
            std::fs::write(path, &text).expect("the file");
        }
        let kept = std::fs::read_to_string(path).expect("the file");
        assert!(
            kept == text,
            "crates/web/openapi.json is not what the code makes: set SCH108BEX_WRITE_OPENAPI=1 and test again"
        );
    }

    #[test]
    fn every_reference_leads_somewhere() {
        fn look(value: &Value, schemas: &Value) {
            match value {
                Value::Object(fields) => {
                    if let Some(Value::String(to)) = fields.get("$ref") {
                        let name = to.strip_prefix("#/components/schemas/").expect("a schema");
                        assert!(schemas.get(name).is_some(), "{name}");
                    }
                    fields.values().for_each(|value| look(value, schemas));
                }
                Value::Array(all) => all.iter().for_each(|value| look(value, schemas)),
                _ => {}
            }
        }
        let document = document();
        look(&document, &document["components"]["schemas"]);
    }

    #[test]
    fn operations_have_names_of_their_own() {
        let mut ids: Vec<_> = ENDPOINTS.iter().map(|endpoint| endpoint.id).collect();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), ENDPOINTS.len());
    }
}
