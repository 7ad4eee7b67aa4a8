// A case read from the server through the host, in parts: hosts refuse messages above about 1 MB.
import type { Host } from "./host";
import type { ResourceContents } from "./host_types";
import { fromBase64, unpack, Opened } from "./unpack";

interface Whole {
  digest: string;
  bytes: number;
  parts: number;
}

/** What the server says of a case before its parts are read. See atw_mcp/viewer/in_parts.py. */
interface Contents {
  document: Whole;
  film: (Whole & { mime: string }) | null;
}

const TRIES = 3; // a case that is worked on changes between two reads
const AWAITED = 3; // parts: a film of so few is waited for, so that the page does not change under people's hands

/** The film that was read last: a case is read again while it is worked on, and its film stays the same. */
let kept = { digest: "", data: "" };

/** Yield the document of a case; where its film is long, first without it. say: shows how far it is. */
export async function* read(
  host: Host,
  identifier: string,
  rollouts: string[],
  say: (text: string) => void,
): AsyncGenerator<Opened> {
  const query = rollouts.length ? `?rollouts=${rollouts.map(encodeURIComponent).join(",")}` : "";
  const address = `atw://view/${encodeURIComponent(identifier)}`;
  for (let attempt = 1; ; attempt++) {
    say("Reading the case …");
    const contents = JSON.parse(await text(host, address + query)) as Contents;
    try {
      const count = (what: string) => (n: number, of: number) => say(`Reading the ${what}: part ${n} of ${of} …`);
      const parts = await whole(host, address, query, contents.document, count("case"));
      const document = await unpack(fromBase64(parts));
      const film = document.document.film;
      if (!film || !contents.film) {
        yield document;
        return;
      }
      if (kept.digest !== contents.film.digest) {
        if (contents.film.parts > AWAITED) yield document.with({ film: null });
        const data = await whole(host, address, query, contents.film, count("film"));
        kept = { digest: contents.film.digest, data };
      }
      // A data: address, because hosts need not allow blob: ones for films.
      const url = `data:${contents.film.mime.replaceAll(" ", "")};base64,${kept.data}`;
      yield document.with({ film: { ...film, url } });
      return;
    } catch (error) {
      if (attempt === TRIES) throw error;
    }
  }
}

/** All parts, as one text in base64: each but the last is a multiple of three bytes, so that their texts join. */
async function whole(
  host: Host,
  address: string,
  query: string,
  of: Whole,
  each: (n: number, of: number) => void,
): Promise<string> {
  const texts: string[] = [];
  for (let part = 0; part < of.parts; part++) {
    if (of.parts > 1) each(part + 1, of.parts);
    const { contents } = await resource(host, `${address}/${of.digest}/${part}${query}`);
    texts.push(contents[0]?.blob ?? "");
  }
  return texts.join("");
}

async function text(host: Host, uri: string): Promise<string> {
  return (await resource(host, uri)).contents[0]?.text ?? "";
}

function resource(host: Host, uri: string): Promise<ResourceContents> {
  return host.request<ResourceContents>("resources/read", { uri });
}
