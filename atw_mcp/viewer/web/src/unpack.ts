// A packed document: gzip of "ATWV", the length of the JSON, the JSON, the arrays. See atw_mcp/viewer/packing.py.
import type { Block, ViewDocument } from "./document";

export type Numbers = Float32Array | Int32Array | Uint16Array | Uint8Array;

const KINDS = { float32: Float32Array, int32: Int32Array, uint16: Uint16Array, uint8: Uint8Array } as const;

/** A document with the arrays that its blocks refer to. */
export class Opened {
  private readonly views = new Map<string, Numbers>();

  constructor(
    readonly document: ViewDocument,
    private readonly section: ArrayBuffer,
  ) {}

  /** The same with other parts, on the same arrays. */
  with(changes: Partial<ViewDocument>): Opened {
    return new Opened({ ...this.document, ...changes }, this.section);
  }

  /** The numbers of a block, without a copy. */
  numbers(block: Block): Numbers {
    const key = `${block.offset}:${block.dtype}`;
    let view = this.views.get(key);
    if (view === undefined) {
      const count = block.shape.reduce((a, b) => a * b, 1);
      view = new KINDS[block.dtype](this.section, block.offset, count);
      this.views.set(key, view);
    }
    return view;
  }

  floats(block: Block): Float32Array {
    return this.numbers(block) as Float32Array;
  }
}

const FORMAT = "atw-view/1";
const INCOMPLETE = "The document of this page is damaged or incomplete: write the report again.";

export async function unpack(bytes: Uint8Array<ArrayBuffer>): Promise<Opened> {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const whole = await new Response(stream).arrayBuffer().catch(() => {
    throw new Error(INCOMPLETE);
  });
  const head = new DataView(whole);
  if (head.getUint32(0, false) !== 0x41545756) throw new Error("this is no document of the viewer");
  const length = head.getUint32(4, true);
  const text = new TextDecoder().decode(new Uint8Array(whole, 8, length));
  const document = JSON.parse(text) as ViewDocument;
  if (document.format !== FORMAT) {
    throw new Error(`This page reads ${FORMAT}, and its document is ${document.format}: load the page again, or write the report again.`);
  }
  return new Opened(document, whole.slice(8 + length));
}

export function fromBase64(text: string): Uint8Array<ArrayBuffer> {
  const characters = decoded(text.trim());
  const bytes = new Uint8Array(characters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = characters.charCodeAt(i);
  return bytes;
}

function decoded(text: string): string {
  try {
    return atob(text);
  } catch {
    throw new Error(INCOMPLETE);
  }
}
