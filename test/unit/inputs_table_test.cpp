// SPDX-License-Identifier: BSD-3-Clause
// Walks the table of docs/inputs.md: what it says of every field is what happens to an example.
#include "dsorb/error.h"
#include "dsorb/io/calibration_reader.h"

#include "support/temporary_folder.h"
#include "support/text_files.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>
#include <string>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

/// Cameras that examples with several are asked for.
const std::map<std::string, std::string> kChosen = {{"opencv_stereo.yml", "M2"},
                                                    {"orbslam3.yaml", "Camera2"},
                                                    {"basalt.json", "cam1"},
                                                    {"kitti.txt", "image_2"},
                                                    {"kitti_raw.txt", "image_02"},
                                                    {"colmap_opencv.txt", "1"}};

std::string calibrationIn(const fs::path& file) {
  const auto chosen = kChosen.find(file.filename().string());
  CameraChoice choice;
  choice.name = chosen == kChosen.end() ? "/right/image_raw" : chosen->second;
  const Calibration c = readCalibration(file, choice);
  return fmt::format("{} {} {} {} {} {} {}x{} {}+-{} {} | {} {}x{} {} {} {}",
                     static_cast<int>(c.lens.model),
                     c.lens.fx,
                     c.lens.fy,
                     c.lens.cx,
                     c.lens.cy,
                     fmt::join(c.lens.coefficients, " "),
                     c.lens.width,
                     c.lens.height,
                     c.lens.readout.seconds,
                     c.lens.readout.sigma,
                     c.lens.columns,
                     static_cast<int>(c.rectification.mode),
                     c.rectification.width,
                     c.rectification.height,
                     c.rectification.camera.fx,
                     c.rectification.camera.cx,
                     c.cut);
}

/// What is read of an example, by the folder of the corpus that it lies in.
const std::map<std::string, std::function<std::string(const fs::path&)>> kReaders = {
    {"calibration", calibrationIn},
    {"calibration_yaml", calibrationIn},
    {"calibration_json", calibrationIn},
    {"calibration_xml", calibrationIn}};

struct Row {
  std::string example;
  std::string field;
  std::string treatment;
  std::string from;
  std::string to;
};

std::string withLineBreaks(std::string text) {
  for (std::size_t at = 0; (at = text.find("\\n", at)) != std::string::npos;) {
    text.replace(at, 2, "\n");
  }
  return text;
}

/// Rows of the table with a change to try; the others name what tries them.
std::vector<Row> rows() {
  std::istringstream page(readText(DSORB_INPUTS));
  std::vector<Row> result;
  for (std::string line; std::getline(page, line);) {
    std::vector<std::string> cells;
    std::istringstream stream(line);
    for (std::string cell; std::getline(stream, cell, '|');) {
      cells.push_back(cell.size() > 2 ? cell.substr(1, cell.size() - 2) : "");
    }
    if (cells.size() < 6 || cells[5].front() != '`') continue;
    const std::string& change = cells[5];
    const std::size_t middle = change.find("` to `");
    result.push_back({cells[1],
                      cells[2],
                      cells[3],
                      withLineBreaks(change.substr(1, middle - 1)),
                      withLineBreaks(change.substr(middle + 6, change.size() - middle - 7))});
  }
  return result;
}

/// What an error must name: the last part of a key, or a line.
std::string keyOf(const std::string& field) {
  if (field.compare(0, 5, "line ") == 0) return ":" + field.substr(5);
  const std::string first = field.substr(0, field.find_first_of(":, "));
  return first.substr(first.rfind('.') + 1);
}

class InputsTable : public testing::Test {
 protected:
  /// What is read, or "error: " and why it is refused.
  std::string outcome(const fs::path& example, const std::string& text) {
    const fs::path file = folder_.path() / example.filename();
    std::ofstream(file, std::ios::binary) << text;
    try {
      return kReaders.at(example.parent_path().filename().string())(file);
    } catch (const IoError& error) {
      return std::string("error: ") + error.what();
    }
  }
  TemporaryFolder folder_;
};

fs::path exampleOf(const std::string& name) {
  for (const auto& reader : kReaders) {
    const fs::path file = fs::path(DSORB_CORPUS) / reader.first / name;
    if (fs::exists(file)) return file;
  }
  return {};
}

TEST_F(InputsTable, SaysWhatHappensToEveryField) {
  const std::vector<Row> table = rows();
  EXPECT_GT(table.size(), 150U);
  for (const Row& row : table) {
    SCOPED_TRACE(fmt::format("{}, {}, {}", row.example, row.field, row.to));
    const fs::path example = exampleOf(row.example);
    ASSERT_FALSE(example.empty());
    std::string text = readText(example);
    const std::string before = outcome(example, text);
    EXPECT_THAT(before, testing::Not(testing::HasSubstr("error: ")));
    const std::size_t place = text.find(row.from);
    ASSERT_NE(place, std::string::npos);
    const std::string after = outcome(example, text.replace(place, row.from.size(), row.to));
    if (row.treatment == "used") {
      EXPECT_NE(after, before);
    } else if (row.treatment == "ignored") {
      EXPECT_EQ(after, before);
    } else {
      EXPECT_EQ(row.treatment, "refused");
      EXPECT_THAT(
          after,
          testing::AllOf(testing::HasSubstr("error: "), testing::HasSubstr(keyOf(row.field))));
    }
  }
}

}  // namespace
}  // namespace dsorb
