// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/camera_choice.h"

#include "io/text_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <string_view>
#include <tuple>
#include <utility>

namespace dsorb {
namespace {

constexpr int kFolders = 3;  // of a path that may be called as a camera: mav0/cam1/data.csv

bool isTopic(const std::string& name) {
  return !name.empty() && name.front() == '/';
}

/// Without the ending that image_transport gives the topic of other encodings.
std::string_view plainTopic(std::string_view topic) {
  for (const std::string_view ending : {"/compressed", "/compressedDepth", "/theora"}) {
    if (topic.size() > ending.size() && topic.substr(topic.size() - ending.size()) == ending) {
      topic.remove_suffix(ending.size());
    }
  }
  return topic;
}

bool isCalled(const NamedCamera& camera, std::string_view name) {
  return std::any_of(camera.names.begin(), camera.names.end(), [&](const std::string& own) {
    return isTopic(own) ? plainTopic(own) == plainTopic(name) : own == name;
  });
}

/// The camera that the last folder is called after that is called after one.
const NamedCamera* findFolder(const std::vector<NamedCamera>& cameras,
                              const std::filesystem::path& path,
                              int folders) {
  const std::vector<std::filesystem::path> parts(path.begin(), path.end());
  for (auto part = parts.rbegin(); part != parts.rend() && folders > 0; ++part, --folders) {
    for (const NamedCamera& camera : cameras) {
      if (isCalled(camera, part->string()) || isCalled(camera, part->stem().string())) {
        return &camera;
      }
    }
  }
  return nullptr;
}

const NamedCamera* find(const std::vector<NamedCamera>& cameras, const CameraChoice& choice) {
  if (choice.name.empty()) return findFolder(cameras, choice.images, kFolders);
  const auto called = std::find_if(cameras.begin(), cameras.end(), [&](const NamedCamera& camera) {
    return isCalled(camera, choice.name);
  });
  if (called != cameras.end()) return &*called;
  if (!isTopic(choice.name)) return nullptr;
  const std::filesystem::path topic = choice.name;
  return findFolder(cameras, topic, static_cast<int>(std::distance(topic.begin(), topic.end())));
}

bool areSame(const Calibration& a, const Calibration& b) {
  const auto numbers = [](const Lens& l) {
    return std::tuple(l.model, l.fx, l.fy, l.cx, l.cy, l.coefficients, l.width, l.height);
  };
  return numbers(a.lens) == numbers(b.lens) && a.lens.readout.seconds == b.lens.readout.seconds &&
         a.lens.readout.sigma == b.lens.readout.sigma && a.lens.columns == b.lens.columns;
}

/// Whether it does not matter which one is meant.
bool areAllSame(const std::vector<NamedCamera>& cameras) {
  try {
    const Calibration first = cameras.front().read();
    return std::all_of(cameras.begin() + 1, cameras.end(), [&](const NamedCamera& camera) {
      return areSame(first, camera.read());
    });
  } catch (const IoError&) {
    return false;
  }
}

std::string listed(const std::vector<NamedCamera>& cameras) {
  std::string list;
  for (const NamedCamera& camera : cameras) {
    list += fmt::format("{}{}", list.empty() ? "" : ", ", camera.names.front());
    if (isTopic(camera.names.back())) list += fmt::format(" ({})", camera.names.back());
  }
  return list;
}

}  // namespace

Calibration readChosen(const std::filesystem::path& file,
                       const std::vector<NamedCamera>& cameras,
                       const CameraChoice& choice) {
  if (cameras.empty()) throw lineError(file, 0, "has no camera; at least one is expected");
  const bool nameless = cameras.size() == 1 && cameras.front().names.empty();
  if (nameless) return cameras.front().read();
  if (const NamedCamera* camera = find(cameras, choice)) return camera->read();
  if (!choice.name.empty() && (cameras.size() > 1 || !isTopic(choice.name))) {
    throw lineError(file,
                    0,
                    fmt::format("has no camera '{}'; choose one with --camera: {}",
                                quotable(choice.name),
                                listed(cameras)));
  }
  if (cameras.size() == 1 || areAllSame(cameras)) return cameras.front().read();
  throw lineError(
      file,
      0,
      fmt::format("has {} cameras, and the images do not say which one took them; choose it with "
                  "--camera: {}",
                  cameras.size(),
                  listed(cameras)));
}

}  // namespace dsorb
