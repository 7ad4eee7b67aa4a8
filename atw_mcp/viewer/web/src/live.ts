// A page that follows a case while it is worked on: the server sends an event when the document has changed.
export async function follow(): Promise<void> {
  throw new Error("no live server yet");
}
