// Supervoxels and locally convex connected patches by the Point Cloud Library, for comparison.
//
// Usage: pcl_lccp VOXEL SEED COLOUR SPATIAL NORMAL CONCAVITY_DEG SMOOTHNESS SANITY TRANSFORM
//
// Reads one path a line from standard input: n points of 16 bytes (x, y, z float32, RGBA uint8).
// Segments it, writes the labels beside it (PATH.labels, n uint32) and prints the seconds of one
// processor from cloud to labels.

#include <cstdint>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iostream>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <pcl/point_types.h>
#include <pcl/segmentation/lccp_segmentation.h>
#include <pcl/segmentation/supervoxel_clustering.h>

using Point = pcl::PointXYZRGBA;

static pcl::PointCloud<Point>::Ptr read(const std::string& path) {
  pcl::PointCloud<Point>::Ptr cloud(new pcl::PointCloud<Point>);
  std::ifstream file(path, std::ios::binary);
  struct Row { float x, y, z; std::uint8_t r, g, b, a; } row;
  while (file.read(reinterpret_cast<char*>(&row), sizeof row)) {
    Point point;
    point.x = row.x; point.y = row.y; point.z = row.z;
    point.r = row.r; point.g = row.g; point.b = row.b; point.a = 255;
    cloud->push_back(point);
  }
  return cloud;
}

int main(int count, char** words) {
  if (count != 10) {
    std::cerr << "expected 9 numbers\n";
    return 2;
  }
  std::vector<double> number;
  for (int i = 1; i < count; ++i) number.push_back(std::atof(words[i]));
  for (std::string path; std::getline(std::cin, path);) {
    const auto cloud = read(path);
    const std::clock_t start = std::clock();
    pcl::SupervoxelClustering<Point> super(number[0], number[1]);
    super.setUseSingleCameraTransform(number[8] > 0);
    super.setInputCloud(cloud);
    super.setColorImportance(number[2]);
    super.setSpatialImportance(number[3]);
    super.setNormalImportance(number[4]);
    std::map<std::uint32_t, pcl::Supervoxel<Point>::Ptr> clusters;
    super.extract(clusters);
    std::multimap<std::uint32_t, std::uint32_t> adjacency;
    super.getSupervoxelAdjacency(adjacency);
    pcl::LCCPSegmentation<Point> lccp;
    lccp.setConcavityToleranceThreshold(number[5]);
    lccp.setSmoothnessCheck(number[6] > 0, number[0], number[1], number[6]);
    lccp.setSanityCheck(number[7] > 0);
    lccp.setInputSupervoxels(clusters, adjacency);
    lccp.segment();
    auto labelled = *super.getLabeledCloud();
    lccp.relabelCloud(labelled);
    const double seconds = double(std::clock() - start) / CLOCKS_PER_SEC;
    std::ofstream out(path + ".labels", std::ios::binary);
    for (const auto& point : labelled)
      out.write(reinterpret_cast<const char*>(&point.label), sizeof point.label);
    out.close();
    std::cout << seconds << std::endl;
  }
}
