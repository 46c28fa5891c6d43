/* The cursor of a page whose charts are not over time: a scene has it alone. */

const cursor = { listeners: [], point: (time) => cursor.listeners.forEach((f) => f(time)), follow: (f) => cursor.listeners.push(f) };
