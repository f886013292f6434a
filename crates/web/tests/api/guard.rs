//! Who is let in, and who is not.

use std::net::TcpListener;

use web::{Server, Settings, Setup, Shown, StartError, Token};

use crate::client::{TOKEN, site, site_at};

#[test]
fn every_answer_tells_browsers_to_be_careful() {
    let site = site();
    for answer in
        [site.get("/"), site.get("/api/snapshot"), site.get("/nothing"), site.post("/api/commands", "x")]
    {
        let policy = answer.header("content-security-policy").expect("a policy");
        for part in ["default-src 'self'", "object-src 'none'", "base-uri 'none'", "frame-ancestors 'none'"] {
            assert!(policy.contains(part), "{policy}");
        }
        assert!(!policy.contains("unsafe"), "{policy}");
        assert_eq!(answer.header("x-content-type-options"), Some("nosniff"));
        assert_eq!(answer.header("referrer-policy"), Some("no-referrer"));
        assert_eq!(answer.header("access-control-allow-origin"), None);
    }
}

#[test]
fn a_name_of_another_site_that_leads_here_is_refused() {
    let site = site();
    let port = site.address.port();
    for host in ["evil.example", "127.0.0.1.evil.example", "127.0.0.1", "localhost.", "10.0.0.1", ""] {
        let host = format!("{host}:{port}");
        let answer = site.request("GET", "/api/snapshot").host(Some(&host)).send();
        let known = matches!(host.split(':').next(), Some("127.0.0.1"));
        if known {
            assert_eq!(answer.status, 200, "{host}");
        } else {
            let detail = answer.problem(403);
            assert!(detail.contains(&format!("http://127.0.0.1:{port}/")), "{detail}");
        }
    }
    for host in [format!("localhost:{port}"), format!("LOCALHOST:{port}"), format!("[::1]:{port}")] {
        assert_eq!(site.request("GET", "/").host(Some(&host)).send().status, 200, "{host}");
    }
    for host in ["127.0.0.1", "localhost", "localhost:1", "127.0.0.1:99999"] {
        site.request("GET", "/").host(Some(host)).send().problem(403);
    }
    site.request("GET", "/").host(None).send().problem(403);
    let twice = site.request("GET", "/").header("Host", "evil.example").send();
    assert!(twice.status == 403 || twice.status == 400, "{}", twice.status);
}

#[test]
fn a_page_of_another_site_cannot_ask() {
    let site = site();
    let own = format!("http://{}", site.address);
    let command = r#"{"do":"supply","volts":8.5}"#;
    let with = |name: &str, value: &str| {
        site.request("POST", "/api/commands").header(name, value).json(command).send()
    };
    for origin in
        ["http://evil.example", "null", "https://127.0.0.1", "http://127.0.0.1:1", &format!("{own}0"), "é"]
    {
        let detail = with("Origin", origin).problem(403);
        assert!(detail.contains("another site"), "{detail}");
    }
    for fetched in ["cross-site", "same-site", "anything"] {
        with("Sec-Fetch-Site", fetched).problem(403);
    }
    let volts = site.get("/api/snapshot").json()["encoders"][0]["volts"].clone();
    assert_eq!(volts, 24.0, "nothing of that was done");
    assert_eq!(with("Origin", &own).status, 200);
    assert_eq!(with("Sec-Fetch-Site", "same-origin").status, 200);
    assert_eq!(with("Sec-Fetch-Site", "none").status, 200);
}

#[test]
fn a_link_of_another_site_opens_the_page_and_nothing_else() {
    let site = site();
    let follow = |path: &str| {
        let asking = site.request("GET", path).header("Sec-Fetch-Site", "cross-site");
        asking.header("Sec-Fetch-Mode", "navigate").send()
    };
    assert_eq!(follow("/").status, 200);
    follow("/api/snapshot").problem(403);
    let picture =
        site.request("GET", "/").header("Sec-Fetch-Site", "cross-site").header("Sec-Fetch-Mode", "no-cors");
    picture.send().problem(403);
}

#[test]
fn a_form_of_another_site_cannot_look_like_a_command() {
    // What forms can send without asking first.
    let site = site();
    for media in ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x"] {
        let asking = site.request("POST", "/api/commands").header("Content-Type", media);
        asking.body(br#"{"do":"supply","volts":8.5}"#).send().problem(415);
    }
    site.request("POST", "/api/commands").body(br#"{"do":"supply","volts":8.5}"#).send().problem(415);
    let asking =
        site.request("POST", "/api/commands").header("Content-Type", "Application/JSON; charset=utf-8");
    assert_eq!(asking.body(br#"{"do":"supply","volts":8.5}"#).send().status, 200);
}

#[test]
fn other_computers_need_the_token() {
    let mut site = site_at("0.0.0.0:0", Some(TOKEN));
    site.address.set_ip([127, 0, 0, 1].into());
    for path in ["/", "/api/snapshot", "/api/stream", "/nothing", "/?token=fedcba9876543210", "/?token="] {
        let answer = site.get(path);
        let detail = answer.problem(401);
        assert!(detail.contains("?token="), "{detail}");
        assert_eq!(answer.header("www-authenticate"), Some("Bearer"));
        assert_eq!(answer.header("set-cookie"), None);
    }
    let with =
        |name: &str, value: &str| site.request("GET", "/api/snapshot").header(name, value).send().status;
    assert_eq!(with("Authorization", &format!("Bearer {TOKEN}")), 200);
    assert_eq!(with("Authorization", &format!("bearer  {TOKEN}")), 200);
    for wrong in
        [format!("Bearer {TOKEN}0"), format!("Basic {TOKEN}"), TOKEN.to_owned(), "Bearer ".to_owned()]
    {
        assert_eq!(with("Authorization", &wrong), 401, "{wrong}");
    }
    // A name in the address is fine: other computers may know this one by any.
    let asking = site.request("GET", "/api/snapshot").host(Some("bench.example:8108"));
    assert_eq!(asking.header("Authorization", &format!("Bearer {TOKEN}")).send().status, 200);
}

#[test]
fn the_token_of_the_address_becomes_a_cookie() {
    let site = site_at("127.0.0.1:0", Some(TOKEN));
    let first = site.get(&format!("/?token={TOKEN}"));
    assert_eq!(first.status, 303);
    assert_eq!(first.header("location"), Some("/"), "the token is not in the address any more");
    let cookie = first.header("set-cookie").expect("a cookie").to_owned();
    for part in ["HttpOnly", "SameSite=Strict", "Path=/"] {
        assert!(cookie.contains(part), "{cookie}");
    }
    let pair = cookie.split(';').next().expect("a pair").to_owned();
    let with = |cookie: &str| site.request("GET", "/").header("Cookie", cookie).send().status;
    assert_eq!(with(&pair), 200);
    assert_eq!(with(&format!("a=b; {pair}; c=d")), 200);
    assert_eq!(with(&format!("{pair}0")), 401);
    assert_eq!(with(&format!("x{pair}")), 401);
    // With the cookie of the first visit, another site still cannot ask.
    let asking = site.request("GET", "/api/snapshot").header("Cookie", &pair);
    asking.header("Origin", "http://evil.example").send().problem(403);
    let elsewhere = site.get(&format!("//evil.example/?token={TOKEN}"));
    assert_eq!(elsewhere.header("location"), Some("/"));
}

#[test]
fn without_a_token_nobody_listens_for_other_computers() {
    for address in ["0.0.0.0:0", "[::]:0", "192.0.2.1:0"] {
        let settings = Settings { address: address.parse().expect("an address"), token: None };
        let setup = Setup { shown: Shown::Demonstration, on_shutdown: Box::new(|| ()) };
        assert!(matches!(Server::start(&settings, setup), Err(StartError::Open(_))), "{address}");
    }
    assert!(Token::parse("short").is_err());
}

#[test]
fn a_port_that_is_taken_is_told() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("an address");
    let setup = Setup { shown: Shown::Demonstration, on_shutdown: Box::new(|| ()) };
    let error =
        Server::start(&Settings { address, token: None }, setup).expect_err("it is taken").to_string();
    assert!(error.contains(&address.to_string()) && error.contains("another port"), "{error}");
}
