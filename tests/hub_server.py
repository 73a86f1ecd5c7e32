"""A hub of models on this machine, with the addresses of the Hugging Face hub."""

from __future__ import annotations

import hashlib
import http.server
import json
from pathlib import Path

COMMIT = "c0ffee" + "0" * 34


def git_hash(content: bytes) -> str:
    """Return the hash of a file in git, as `git hash-object` computes it."""
    return hashlib.sha1(b"blob " + str(len(content)).encode() + b"\0" + content).hexdigest()


def hub(folder: Path, licence: str = "apache-2.0", requests: list[str] | None = None, commit: str = COMMIT) -> type:
    """Return the answers of a hub that has the model `org/model`, the files of `folder`, at `main` and at one commit.

    Args:
        folder: The files. They may change while the hub states the hashes that they had at first.
        licence: Licence in the model's card.
        requests: Receives the method and path of each request.
        commit: The commit of `main`.
    """
    siblings = []
    for path in sorted(folder.iterdir()):
        content = path.read_bytes()
        entry = {"rfilename": path.name, "size": len(content), "blobId": git_hash(content)}
        if path.suffix in (".safetensors", ".bin"):
            entry["lfs"] = {"sha256": hashlib.sha256(content).hexdigest(), "size": len(content), "pointerSize": 134}
        siblings.append(entry)
    info = {"id": "org/model", "sha": commit, "siblings": siblings, "cardData": {"license": licence}, "tags": []}

    class Answers(http.server.BaseHTTPRequestHandler):
        def log_message(self, *arguments):
            pass

        def do_HEAD(self):
            self.answer(body=False)

        def do_GET(self):
            self.answer(body=True)

        def answer(self, body: bool) -> None:
            path = self.path.partition("?")[0]
            if requests is not None:
                requests.append(f"{self.command} {path}")
            if path in (f"/api/models/org/model/revision/{name}" for name in ("main", commit)):
                return self.send(200, json.dumps(info).encode(), body, {"Content-Type": "application/json"})
            if path.startswith("/api/models/org/model/revision/"):
                return self.send(404, b"{}", body, {"X-Error-Code": "RevisionNotFound"})
            if path.startswith("/api/models/org/gated"):
                return self.send(403, b"{}", body, {"X-Error-Code": "GatedRepo"})
            start = f"/org/model/resolve/{commit}/"
            file = folder / path.removeprefix(start)
            if path.startswith(start) and file.is_file():
                content = file.read_bytes()
                return self.send(200, content, body, {"ETag": f'"{git_hash(content)}"', "X-Repo-Commit": commit})
            return self.send(404, b"{}", body, {"X-Error-Code": "RepoNotFound"})

        def send(self, code: int, content: bytes, body: bool, headers: dict[str, str]) -> None:
            self.send_response(code)
            for name, value in {**headers, "Content-Length": str(len(content))}.items():
                self.send_header(name, value)
            self.end_headers()
            if body:
                self.wfile.write(content)

    return Answers
