// SPDX-License-Identifier: BSD-3-Clause
#include "place/map_file.h"

#include "dsorb/error.h"

#include <sqlite3.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <type_traits>
#include <utility>

namespace dsorb::place {
namespace {

constexpr int kApplication = 0x64736F72;  // "dsor"
constexpr int kVersion = 1;
constexpr int kPinhole = 1;  // COLMAP's number of the camera model
constexpr float kHalfPixel = 0.5F;

constexpr const char* kSchema = R"(
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY NOT NULL, model INTEGER NOT NULL, width INTEGER NOT NULL,
  height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE images (image_id INTEGER PRIMARY KEY NOT NULL, name TEXT NOT NULL UNIQUE, camera_id INTEGER NOT NULL);
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);
CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);
CREATE TABLE dsorb_keyframes (image_id INTEGER PRIMARY KEY NOT NULL, frame INTEGER NOT NULL, timestamp REAL NOT NULL,
  segment INTEGER NOT NULL, stretch INTEGER NOT NULL, radial REAL NOT NULL, T_world_cam BLOB NOT NULL, octaves BLOB, tracks BLOB,
  inverse_depths BLOB, sigmas BLOB);
)";

struct CloseDatabase {
  void operator()(sqlite3* database) const { sqlite3_close(database); }
};

/// A map file; every error names it.
class Database {
 public:
  Database(std::string path, int flags) : path_(std::move(path)) {
    sqlite3* opened = nullptr;
    const int outcome = sqlite3_open_v2(path_.c_str(), &opened, flags, nullptr);
    handle_.reset(opened);
    if (outcome != SQLITE_OK) fail(sqlite3_errmsg(opened));
  }
  [[noreturn]] void fail(const std::string& what) const { throw IoError(path_ + ": " + what); }
  void run(const std::string& sql) const {
    if (sqlite3_exec(handle_.get(), sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) {
      fail(sqlite3_errmsg(handle_.get()));
    }
  }
  [[nodiscard]] sqlite3* get() const { return handle_.get(); }

 private:
  std::string path_;
  std::unique_ptr<sqlite3, CloseDatabase> handle_;
};

/// A statement whose values are bound and read from left to right.
class Statement {
 public:
  Statement(const Database& database, const char* sql) : database_(database) {
    if (sqlite3_prepare_v2(database.get(), sql, -1, &statement_, nullptr) != SQLITE_OK) {
      database.fail(std::string("not a map of dsorb, or damaged: ") +
                    sqlite3_errmsg(database.get()));
    }
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& operator<<(sqlite3_int64 value) {
    sqlite3_bind_int64(statement_, ++bound_, value);
    return *this;
  }
  Statement& operator<<(double value) {
    sqlite3_bind_double(statement_, ++bound_, value);
    return *this;
  }
  Statement& operator<<(const std::string& text) {
    sqlite3_bind_text(statement_, ++bound_, text.c_str(), -1, SQLITE_TRANSIENT);
    return *this;
  }
  template <typename Value>
  Statement& operator<<(const std::vector<Value>& values) {
    static_assert(std::is_trivially_copyable_v<Value>);
    sqlite3_bind_blob64(
        statement_, ++bound_, values.data(), values.size() * sizeof(Value), SQLITE_TRANSIENT);
    return *this;
  }
  /// @return whether there is a row
  bool step() {
    column_ = 0;
    const int outcome = sqlite3_step(statement_);
    if (outcome != SQLITE_ROW && outcome != SQLITE_DONE) {
      database_.fail(std::string("damaged: ") + sqlite3_errmsg(database_.get()));
    }
    return outcome == SQLITE_ROW;
  }
  void done() {
    step();
    sqlite3_reset(statement_);
    bound_ = 0;
  }
  std::string text() {
    const unsigned char* const characters = sqlite3_column_text(statement_, column_++);
    return characters == nullptr ? "" : reinterpret_cast<const char*>(characters);
  }
  int integer() { return sqlite3_column_int(statement_, column_++); }
  double real() {
    const double value = sqlite3_column_double(statement_, column_++);
    if (!std::isfinite(value)) database_.fail("damaged: a number that is not finite");
    return value;
  }
  template <typename Value>
  std::vector<Value> values(std::size_t expected) {
    const void* const bytes = sqlite3_column_blob(statement_, column_);
    const auto size = static_cast<std::size_t>(sqlite3_column_bytes(statement_, column_++));
    if (size != expected * sizeof(Value)) {
      database_.fail("damaged: " + std::to_string(size) + " bytes where " +
                     std::to_string(expected * sizeof(Value)) + " are expected");
    }
    std::vector<Value> result(expected);
    if (size > 0) std::memcpy(static_cast<void*>(result.data()), bytes, size);
    return result;
  }

 private:
  const Database& database_;
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
  int column_ = 0;
};

std::vector<double> numbersOf(const SE3& pose) {
  const Eigen::Vector3d& t = pose.translation();
  const Eigen::Vector4d q = pose.unitQuaternion().coeffs();
  return {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()};
}

std::vector<float> keypointsOf(const View& view) {
  std::vector<float> numbers;
  for (const Eigen::Vector2f& pixel : view.pixels) {
    numbers.push_back(pixel.x() + kHalfPixel);
    numbers.push_back(pixel.y() + kHalfPixel);
  }
  return numbers;
}

void insert(const Database& database, const std::vector<StoredKeyframe>& keyframes) {
  Statement camera(database, "INSERT INTO cameras VALUES (?, ?, ?, ?, ?, 1)");
  Statement image(database, "INSERT INTO images VALUES (?, ?, ?)");
  Statement corners(database, "INSERT INTO keypoints VALUES (?, ?, 2, ?)");
  Statement descriptors(database, "INSERT INTO descriptors VALUES (?, ?, 32, ?)");
  Statement keyframe(database,
                     "INSERT INTO dsorb_keyframes VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  sqlite3_int64 number = 0;
  for (const StoredKeyframe& k : keyframes) {
    ++number;
    const auto count = static_cast<sqlite3_int64>(k.view.size());
    const std::vector<double> parameters = {
        k.camera.fx, k.camera.fy, k.camera.cx + kHalfPixel, k.camera.cy + kHalfPixel};
    (camera << number << sqlite3_int64{kPinhole} << sqlite3_int64{k.camera.width}
            << sqlite3_int64{k.camera.height} << parameters)
        .done();
    (image << number
           << "segment " + std::to_string(k.segment) + " frame " + std::to_string(k.id.value) +
                  " keyframe " + std::to_string(number)
           << number)
        .done();
    (corners << number << count << keypointsOf(k.view)).done();
    (descriptors << number << count << k.view.descriptors).done();
    (keyframe << number << sqlite3_int64{k.id.value} << k.timestamp << sqlite3_int64{k.segment}
              << sqlite3_int64{k.stretch} << static_cast<double>(k.radial)
              << numbersOf(k.T_world_cam) << k.view.octaves << k.tracks << k.inverse_depths
              << std::vector<float>(k.sigmas.begin(), k.sigmas.end()))
        .done();
  }
}

int pragma(const Database& database, const char* name) {
  Statement statement(database, (std::string("PRAGMA ") + name).c_str());
  return statement.step() ? statement.integer() : 0;
}

std::size_t keyframesIn(const Database& database) {
  Statement count(database, "SELECT count(*) FROM dsorb_keyframes");
  return count.step() ? static_cast<std::size_t>(count.integer()) : 0;
}

void checkMap(const Database& database) {
  if (pragma(database, "application_id") != kApplication) database.fail("not a map of dsorb");
  const int version = pragma(database, "user_version");
  if (version != kVersion) {
    database.fail("a map of version " + std::to_string(version) + "; this program reads version " +
                  std::to_string(kVersion));
  }
  Statement check(database, "PRAGMA quick_check(1)");
  check.step();
  const std::string answer = check.text();
  if (answer != "ok") database.fail("damaged: " + answer);
}

StoredKeyframe keyframeOf(const Database& database, Statement& row) {
  StoredKeyframe k;
  k.id.value = row.integer();
  k.timestamp = row.real();
  k.segment = row.integer();
  k.stretch = row.integer();
  k.radial = static_cast<float>(row.real());
  const std::vector<double> pose = row.values<double>(7);
  k.T_world_cam = SE3(Eigen::Quaterniond(pose[6], pose[3], pose[4], pose[5]),
                      Eigen::Vector3d(pose[0], pose[1], pose[2]));
  k.camera.width = row.integer();
  k.camera.height = row.integer();
  const std::vector<double> parameters = row.values<double>(4);
  k.camera.fx = parameters[0];
  k.camera.fy = parameters[1];
  k.camera.cx = parameters[2] - kHalfPixel;
  k.camera.cy = parameters[3] - kHalfPixel;
  const int rows = row.integer();
  if (rows < 0) database.fail("damaged: a negative number of corners");
  const auto count = static_cast<std::size_t>(rows);
  const std::vector<float> corners = row.values<float>(2 * count);
  k.view.pixels.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    k.view.pixels.emplace_back(corners[2 * i] - kHalfPixel, corners[2 * i + 1] - kHalfPixel);
  }
  k.view.descriptors = row.values<BinaryDescriptor>(count);
  k.view.octaves = row.values<std::uint8_t>(count);
  k.tracks = row.values<std::uint32_t>(count);
  k.inverse_depths = row.values<float>(count);
  k.sigmas.reserve(count);
  for (const float sigma : row.values<float>(count)) k.sigmas.emplace_back(sigma);
  if (!k.T_world_cam.matrix().allFinite() || !(k.camera.fx > 0) || !(k.camera.fy > 0) ||
      k.camera.width <= 0 || k.camera.height <= 0) {
    database.fail("damaged: keyframe " + std::to_string(k.id.value) + " has no pose or no camera");
  }
  return k;
}

}  // namespace

void writeMap(const std::string& path, const std::vector<StoredKeyframe>& keyframes) {
  if (std::filesystem::exists(path)) checkMap(Database(path, SQLITE_OPEN_READONLY));
  const std::string part = path + ".part";
  std::error_code error;
  std::filesystem::remove(part, error);
  {
    const Database database(part, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
    database.run(
        "PRAGMA journal_mode = OFF; PRAGMA application_id = " + std::to_string(kApplication) +
        "; PRAGMA user_version = " + std::to_string(kVersion) + "; BEGIN;" + kSchema);
    insert(database, keyframes);
    database.run("COMMIT");
  }
  std::filesystem::rename(part, path, error);
  if (error) throw IoError(path + ": " + error.message());
}

std::vector<StoredKeyframe> readMap(const std::string& path) {
  if (!std::filesystem::exists(path)) throw IoError(path + ": no such file");
  const Database database(path, SQLITE_OPEN_READONLY);
  checkMap(database);
  Statement row(
      database,
      "SELECT frame, timestamp, segment, stretch, radial, T_world_cam, width, height, params, "
      "keypoints.rows, keypoints.data, descriptors.data, octaves, tracks, inverse_depths, "
      "sigmas FROM dsorb_keyframes JOIN images USING (image_id) JOIN cameras USING "
      "(camera_id) JOIN keypoints USING (image_id) JOIN descriptors USING (image_id) "
      "ORDER BY image_id");
  std::vector<StoredKeyframe> keyframes;
  while (row.step()) keyframes.push_back(keyframeOf(database, row));
  if (keyframes.size() != keyframesIn(database)) {
    database.fail("damaged: keyframes without their corners");
  }
  return keyframes;
}

}  // namespace dsorb::place
