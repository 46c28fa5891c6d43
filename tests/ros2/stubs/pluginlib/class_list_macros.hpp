#pragma once

// Exports a function that makes an object of the class.
#define PLUGINLIB_EXPORT_CLASS(class_type, base_class_type) \
  extern "C" base_class_type * make_plugin();               \
  extern "C" base_class_type * make_plugin() { return new class_type; }
