// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/output_file.h"

#include "io/text_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <fstream>
#include <regex>
#include <system_error>
#include <utility>
#include <vector>

namespace dsorb::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSummary = "run.json";
constexpr const char* kFigures = "figures";

FileHandle openForWriting(const fs::path& path) {
  FileHandle file(std::fopen(path.string().c_str(), "w+b"));
  if (!file) throw writeError(path);
  std::setvbuf(file.get(), nullptr, _IONBF, 0);
  return file;
}

/// Files of a run, by their names relative to the output folder.
std::vector<fs::path> outputFilesIn(const fs::path& folder) {
  std::vector<fs::path> found;
  for (const fs::path& part : {fs::path(), fs::path(kFigures)}) {
    if (!fs::is_directory(folder / part)) continue;
    for (const auto& entry : fs::directory_iterator(folder / part)) {
      const fs::path name = part / entry.path().filename();
      if (!entry.is_directory() && isOutputFile(name)) found.push_back(name);
    }
  }
  return found;
}

bool isSummaryOf(const std::string& program, const fs::path& run_json) {
  std::ifstream file(run_json);
  const Json json = Json::parse(file, nullptr, false);
  return json.is_object() && json.contains("program") && json["program"] == program;
}

}  // namespace

IoError writeError(const fs::path& path) {
  return fileError(path, "cannot be written: {}", std::generic_category().message(errno));
}

GrowingFile::GrowingFile(fs::path path) : path_(std::move(path)), file_(openForWriting(path_)) {}

void GrowingFile::append(std::string_view text) {
  try {
    write(size_, text);
  } catch (const IoError&) {
    std::error_code ignored;
    fs::resize_file(path_, size_, ignored);
    throw;
  }
  size_ += text.size();
}

void GrowingFile::replaceEnd(std::string_view end, std::string_view text) {
  size_ -= end.size();
  try {
    append(text);
  } catch (const IoError&) {
    append(end);
    throw;
  }
}

void GrowingFile::write(std::uintmax_t position, std::string_view text) {
  if (std::fseek(file_.get(), static_cast<long>(position), SEEK_SET) != 0 ||
      std::fwrite(text.data(), 1, text.size(), file_.get()) != text.size()) {
    throw writeError(path_);
  }
}

std::string GrowingFile::read(std::uintmax_t position, std::size_t bytes) const {
  std::string text(bytes, '\0');
  if (std::fseek(file_.get(), static_cast<long>(position), SEEK_SET) != 0 ||
      std::fread(text.data(), 1, bytes, file_.get()) != bytes) {
    throw fileError(path_, "what was written there cannot be read back");
  }
  return text;
}

void replaceFile(const fs::path& path, std::string_view content) {
  const fs::path part = path.string() + ".part";
  FileHandle file = openForWriting(part);
  const bool written = std::fwrite(content.data(), 1, content.size(), file.get()) == content.size();
  std::error_code failed;
  if (std::fclose(file.release()) == 0 && written) {
    fs::rename(part, path, failed);
    if (!failed) return;
    errno = failed.value();
  }
  const IoError error = writeError(path);
  fs::remove(part, failed);
  throw error;
}

bool isFinite(const SE3& pose) {
  return pose.unitQuaternion().coeffs().allFinite() && pose.translation().allFinite();
}

namespace {

/// Translation, quaternion with qw not negative.
std::array<double, 7> numbersOf(const SE3& pose) {
  const Eigen::Vector3d& t = pose.translation();
  const Eigen::Vector4d& q = pose.unitQuaternion().coeffs();
  const double sign = q.w() < 0 ? -1 : 1;
  return {t.x(), t.y(), t.z(), sign * q.x(), sign * q.y(), sign * q.z(), sign * q.w()};
}

}  // namespace

std::string tumLine(double timestamp, const SE3& T_world_cam) {
  return fmt::format("{:.9f} {:.9f}\n", timestamp, fmt::join(numbersOf(T_world_cam), " "));
}

Json poseJson(const SE3& pose) {
  return isFinite(pose) ? Json(numbersOf(pose)) : Json();
}

bool isOutputFile(const fs::path& name) {
  static const std::regex kNames(
      R"((trajectory(_kitti|_\d+)?\.txt|keyframes(_\d+)?\.txt|initialization\.json|frames\.csv|)"
      R"(points\.ply|tracks\.ply|refined_camera\.txt|run\.json|config\.yaml)(\.part)?|)"
      R"(figures/(initial_inverse_depth(_\d+)?|trajectory)\.png(\.part)?)");
  return std::regex_match(name.generic_string(), kNames);
}

OutputFolder::OutputFolder(const fs::path& folder,
                           const std::string& program,
                           std::string_view run_json) {
  const auto refused = [&folder](const std::string& why) {
    return IoError(fmt::format("output folder {}: {}", folder.string(), why));
  };
  try {
    fs::create_directories(folder);
    if (!platform::lockFolder(folder, lock_)) throw refused("another run writes into it");
    if (fs::is_symlink(folder / kFigures)) throw refused("figures there is a link; move it away");
    const std::vector<fs::path> old = outputFilesIn(folder);
    if (!old.empty() && !isSummaryOf(program, folder / kSummary)) {
      throw refused(
          fmt::format("{} there is not from a run of {}; it would be replaced. Choose another "
                      "folder or move it away",
                      old.front().generic_string(),
                      program));
    }
    fs::create_directory(folder / kFigures);
    replaceFile(folder / kSummary, run_json);
    for (const fs::path& name : old) {
      if (name != kSummary) fs::remove(folder / name);
    }
  } catch (const fs::filesystem_error& error) {
    throw refused("cannot be prepared: " + error.code().message());
  }
}

namespace {

constexpr const char* kTimestampKey = "timestamp";

/// A path may hold bytes that are no UTF-8.
std::string dumped(const Json& value) {
  return value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// Arrays of numbers and matrices stay on one line.
bool onOneLine(const Json& value) {
  if (!value.is_array()) return !value.is_structured() || value.empty();
  return std::none_of(
      value.begin(), value.end(), [](const Json& element) { return element.is_structured(); });
}

void write(const Json& value, int depth, std::string& text) {
  if (onOneLine(value)) {
    text += dumped(value);
    return;
  }
  const bool object = value.is_object();
  const char* separator = object ? "{" : "[";
  for (const auto& [key, element] : value.items()) {
    text += fmt::format("{}\n{:{}}", separator, "", depth + 1);
    separator = ",";
    if (object) text += dumped(key) + ": ";
    if (object && key == kTimestampKey && element.is_number_float()) {
      text += fmt::format("{:.9f}", element.get<double>());
    } else {
      write(element, depth + 1, text);
    }
  }
  text += fmt::format("\n{:{}}{}", "", depth, object ? '}' : ']');
}

}  // namespace

std::string jsonText(const Json& value) {
  std::string text;
  write(value, 0, text);
  return text + '\n';
}

Json cameraJson(const PinholeCamera& camera) {
  return {{"fx", camera.fx},
          {"fy", camera.fy},
          {"cx", camera.cx},
          {"cy", camera.cy},
          {"width", camera.width},
          {"height", camera.height}};
}

double shortest(float value) {
  const std::string text = fmt::format("{}", value);
  double result = value;
  std::from_chars(text.data(), text.data() + text.size(), result);
  return result;
}

}  // namespace dsorb::io
